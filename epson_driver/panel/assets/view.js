// Copyright 2026 the epson_driver developers
// SPDX-License-Identifier: Apache-2.0
// The 3D view: the arm, the ghost at the reference, and the tool paths of both. `lib` and `drawing`: bundle.js and arm.js.

const DRIVEN = 0x136fd1, PLANNED = 0xe08a14, GHOST = '#f59f28';
const STEP_M = 0.002, MAX_POINTS = 800;

/** A tool path that grows. */
class ToolPath {
  constructor(scene, colour, width, nearer) {
    this.points = [];
    this.last = null;
    this.changed = false;
    this.line = new lib.Line2(new lib.LineGeometry(), new lib.LineMaterial({
      color: colour, linewidth: width, polygonOffset: true, polygonOffsetFactor: nearer, polygonOffsetUnits: nearer,
    }));
    this.line.visible = false;
    this.line.frustumCulled = false;
    scene.add(this.line);
  }

  add({ x, y, z }) {
    if (this.last && Math.hypot(x - this.last[0], y - this.last[1], z - this.last[2]) < STEP_M) return;
    this.last = [x, y, z];
    this.points.push(this.last);
    if (this.points.length > MAX_POINTS) this.points.shift();
    this.changed = true;
  }

  set(points) {
    this.points = points;
    this.last = null;
    this.changed = true;
  }

  draw() {
    if (!this.changed) return false;
    this.changed = false;
    this.line.visible = this.points.length > 1;
    if (this.line.visible) {
      this.line.geometry.dispose();
      this.line.geometry = new lib.LineGeometry();
      this.line.geometry.setPositions(this.points.flat());
    }
    return true;
  }
}

/** Create the view. Throws an error without WebGL. */
export function makeView(canvas, holder) {
  const { scene, soon, lookAt } = drawing.stage(canvas, holder);
  const driven = new ToolPath(scene, DRIVEN, 2.5, -8), planned = new ToolPath(scene, PLANNED, 5, 0);
  const ball = (color) => new lib.MeshStandardMaterial({ color, roughness: 0.4 });
  const BALL = new lib.SphereGeometry(0.007, 16, 12), TAUGHT = ball(0x8e44ad), CHOSEN = ball(0xd13bb0);
  let markers = [];
  let arm = null, ghost = null, follows = true, grey = false;
  setInterval(() => {
    const news = [driven.draw(), planned.draw()];
    if (news.some(Boolean)) soon();
  }, 200);
  return {
    /** Draw another arm, or none. */
    setArm(packed, size) {
      for (const each of [arm, ghost]) if (each) scene.remove(each.base);
      driven.set([]);
      planned.set([]);
      arm = ghost = null;
      if (packed) {
        const make = drawing.armsOf(packed);
        arm = make(null, 1);
        ghost = make(GHOST, 0.35);
        ghost.base.visible = false;
        scene.add(arm.base, ghost.base);
        grey = false;
        lookAt(size);
      }
      soon();
    },
    /** Draw the tool path of a plan. Without points, it grows with the reference. */
    setPlan(points) {
      driven.set([]);
      planned.set(points || []);
      follows = !points;
    },
    /** Draw markers at places, [x, y, z] in m by name. The marker of `chosen` is larger. */
    setPoints(places, chosen) {
      for (const each of markers) scene.remove(each);
      markers = Object.entries(places).map(([name, place]) => {
        const made = new lib.Mesh(BALL, name === chosen ? CHOSEN : TAUGHT);
        made.position.set(...place);
        made.scale.setScalar(name === chosen ? 2 : 1);
        return made;
      });
      if (markers.length) scene.add(...markers);
      canvas.dataset.points = Object.keys(places).join(' ');
      soon();
    },
    show(joints, plan, fresh) {
      if (!arm) return;
      arm.set(joints);
      driven.add(arm.tool());
      if (plan) {
        ghost.set(plan);
        if (follows) planned.add(ghost.tool());
      }
      ghost.showWhereApart(plan, joints);
      if (grey === fresh) {
        grey = !fresh;
        arm.grey(grey);
      }
      soon();
    },
  };
}
