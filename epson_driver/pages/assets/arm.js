// Copyright 2026 the epson_driver developers
// SPDX-License-Identifier: Apache-2.0
// Draws arms with three.js (`lib` of bundle.js), for the pages of report and panel.
const drawing = (() => {
  'use strict';
  const CREASE = Math.cos(35 * Math.PI / 180);
  const APART = 0.05; // rad or m: the ghost shows a link if a joint before it deviates by more from the measured position

  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;

  /** Return the geometry of a mesh, with smooth shading over edges that bend by less than 35°. */
  function geometryOf(mesh) {
    const corners = new Uint16Array(bytes(mesh.vertices));
    const index = new Uint16Array(bytes(mesh.triangles));
    const point = (n) => [0, 1, 2].map((k) => mesh.low[k] + mesh.size[k] * corners[3 * n + k] / 65535);
    const faces = [], around = new Map();
    for (let f = 0; f < index.length; f += 3) {
      const [a, b, c] = [point(index[f]), point(index[f + 1]), point(index[f + 2])];
      const u = b.map((x, k) => x - a[k]), w = c.map((x, k) => x - a[k]);
      const cross = [u[1] * w[2] - u[2] * w[1], u[2] * w[0] - u[0] * w[2], u[0] * w[1] - u[1] * w[0]];
      const length = Math.hypot(...cross) || 1;
      faces.push({ cross, normal: cross.map((x) => x / length), corners: [a, b, c] });
      for (let k = 0; k < 3; k++) {
        if (!around.has(index[f + k])) around.set(index[f + k], []);
        around.get(index[f + k]).push(faces.length - 1);
      }
    }
    const positions = new Float32Array(index.length * 3), normals = new Float32Array(index.length * 3);
    index.forEach((vertex, i) => {
      const face = faces[Math.floor(i / 3)], sum = [0, 0, 0];
      for (const other of around.get(vertex)) {
        const { normal, cross } = faces[other];
        if (normal[0] * face.normal[0] + normal[1] * face.normal[1] + normal[2] * face.normal[2] >= CREASE) cross.forEach((x, k) => { sum[k] += x; });
      }
      const length = Math.hypot(...sum) || 1;
      for (let k = 0; k < 3; k++) {
        positions[3 * i + k] = face.corners[i % 3][k];
        normals[3 * i + k] = sum[k] / length;
      }
    });
    const made = new lib.BufferGeometry();
    made.setAttribute('position', new lib.BufferAttribute(positions, 3));
    made.setAttribute('normal', new lib.BufferAttribute(normals, 3));
    return made;
  }

  /** Return a function that creates drawings of one arm. `arm`: the data of `packed_arm`. */
  function armsOf(arm) {
    const geometries = arm.meshes.map(geometryOf);
    const axes = arm.axes.map((axis) => new lib.Vector3(...axis));
    return (tint, opacity) => {
      const base = new lib.Group();
      const links = [base];
      arm.origins.forEach((origin) => {
        const link = new lib.Group();
        link.position.fromArray(origin);
        links[links.length - 1].add(link);
        links.push(link);
      });
      const tool = new lib.Group();
      tool.position.fromArray(arm.tool0);
      links[links.length - 1].add(tool);
      const meshes = arm.meshes.map((mesh, i) => {
        const colour = tint ? new lib.Color(tint) : new lib.Color().setRGB(...mesh.colour, 'srgb');
        const made = new lib.Mesh(geometries[i], new lib.MeshStandardMaterial({
          color: colour, roughness: 0.55, metalness: 0.05, side: lib.DoubleSide,
          transparent: opacity < 1, opacity, depthWrite: opacity === 1,
          polygonOffset: opacity < 1, polygonOffsetFactor: 2, polygonOffsetUnits: 8, // the solid arm hides the ghost at the same place
        }));
        made.castShadow = made.receiveShadow = opacity === 1;
        links[mesh.link].add(made);
        return made;
      });
      return {
        base,
        /** Move the joints. */
        set(q) {
          q.forEach((value, j) => {
            const link = links[j + 1];
            if (arm.types[j] === 'prismatic') link.position.fromArray(arm.origins[j]).addScaledVector(axes[j], value);
            else link.quaternion.setFromAxisAngle(axes[j], value);
          });
        },
        /** Show only the links that are elsewhere than with the joints `other`. Without q or other, show none. */
        showWhereApart(q, other) {
          const first = q && other ? q.findIndex((value, j) => Math.abs(value - other[j]) > APART) : -1;
          base.visible = first >= 0;
          arm.meshes.forEach((mesh, i) => { meshes[i].visible = mesh.link > first; });
        },
        /** Draw the arm in grey if its position is stale, else in its colours. */
        grey(stale) {
          arm.meshes.forEach((mesh, i) => {
            if (stale) meshes[i].material.color.set(0x9aa3ab);
            else meshes[i].material.color.setRGB(...mesh.colour, 'srgb');
          });
        },
        /** Return the position of tool0. */
        tool() {
          base.updateWorldMatrix(true, true);
          return tool.getWorldPosition(new lib.Vector3());
        },
      };
    };
  }

  /** Create a lit floor in a canvas that fills `holder`. Throws an error without WebGL. */
  function stage(canvas, holder) {
    const renderer = new lib.WebGLRenderer({ canvas, antialias: true, alpha: true, preserveDrawingBuffer: true }); // the buffer is needed for printing
    renderer.shadowMap.enabled = true;
    renderer.shadowMap.type = lib.PCFShadowMap;
    const scene = new lib.Scene();
    scene.add(new lib.HemisphereLight(0xffffff, 0xb9c2cc, 1.7));
    const sun = new lib.DirectionalLight(0xffffff, 2.1);
    sun.position.set(1.2, -1.6, 2.6);
    sun.castShadow = true;
    sun.shadow.mapSize.set(1024, 1024);
    Object.assign(sun.shadow.camera, { left: -1.3, right: 1.3, top: 1.3, bottom: -1.3, near: 0.1, far: 7 });
    sun.shadow.radius = 5;
    sun.shadow.bias = -0.0006;
    sun.shadow.normalBias = 0.006;
    scene.add(sun);
    const ground = new lib.Mesh(new lib.PlaneGeometry(8, 8), new lib.ShadowMaterial({ opacity: 0.2 }));
    ground.receiveShadow = true;
    scene.add(ground);
    const grid = new lib.GridHelper(3, 30, 0x9fb0c0, 0xd3dbe3);
    grid.rotation.x = Math.PI / 2;
    grid.position.z = -0.0005;
    grid.material.transparent = true;
    scene.add(grid);
    const camera = new lib.PerspectiveCamera(33, 1, 0.02, 40);
    camera.up.set(0, 0, 1);
    const controls = new lib.OrbitControls(camera, renderer.domElement);
    let asked = false;
    const render = () => {
      asked = false;
      renderer.render(scene, camera);
    };
    const soon = () => {
      if (!asked) requestAnimationFrame(render);
      asked = true;
    };
    controls.addEventListener('change', soon);
    new ResizeObserver(() => {
      const { clientWidth, clientHeight } = holder;
      if (!clientWidth || !clientHeight) return;
      renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
      renderer.setSize(clientWidth, clientHeight, false);
      camera.aspect = clientWidth / clientHeight;
      camera.updateProjectionMatrix();
      render();
    }).observe(holder);
    const dark = matchMedia('(prefers-color-scheme: dark)');
    const shade = () => {
      grid.material.opacity = dark.matches ? 0.14 : 0.6;
      soon();
    };
    dark.addEventListener('change', shade);
    shade();
    return {
      scene,
      soon,
      /** Point the camera at an arm with a reach of `size` m. */
      lookAt(size) {
        camera.position.set(1.6 * size + 0.14, -1.6 * size - 0.14, 1.05 * size + 0.22);
        controls.target.set(0.14 * size, 0, 0.53 * size);
        controls.update();
      },
    };
  }

  return { armsOf, bytes, stage };
})();
