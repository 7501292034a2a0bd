// Copyright 2026 the epson_driver developers
// SPDX-License-Identifier: Apache-2.0
// What the pages of report and panel need of three.js and uPlot: make_bundle.sh makes one file of it.
export {
  AmbientLight, BufferAttribute, BufferGeometry, CanvasTexture, Color, DirectionalLight, DoubleSide,
  GridHelper, Group, HemisphereLight, Line, LineBasicMaterial, Mesh, MeshStandardMaterial,
  PCFShadowMap, PerspectiveCamera, PlaneGeometry, CylinderGeometry, SphereGeometry, Scene,
  ShadowMaterial, Vector3, WebGLRenderer,
} from 'three';
export { Line2 } from 'three/examples/jsm/lines/Line2.js';
export { LineGeometry } from 'three/examples/jsm/lines/LineGeometry.js';
export { LineMaterial } from 'three/examples/jsm/lines/LineMaterial.js';
export { OrbitControls } from 'three/examples/jsm/controls/OrbitControls.js';
export { default as uPlot } from 'uplot';
