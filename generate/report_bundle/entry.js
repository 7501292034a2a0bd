// Copyright 2026 the epson_driver developers
// SPDX-License-Identifier: Apache-2.0
// What the report page needs of three.js and uPlot: make_bundle.sh makes one file of it.
export {
  AmbientLight, BufferAttribute, BufferGeometry, CanvasTexture, Color, DirectionalLight, DoubleSide,
  GridHelper, Group, HemisphereLight, Line, LineBasicMaterial, Mesh, MeshStandardMaterial,
  PCFShadowMap, PerspectiveCamera, PlaneGeometry, CylinderGeometry, SphereGeometry, Scene,
  ShadowMaterial, Vector3, WebGLRenderer,
} from 'three';
export { OrbitControls } from 'three/examples/jsm/controls/OrbitControls.js';
export { default as uPlot } from 'uplot';
