// The parts of three.js that companion/ui/page/static/view3d.js uses.
export {
  AmbientLight, BufferGeometry, CanvasTexture, Color, ConeGeometry, DirectionalLight, DoubleSide, EdgesGeometry,
  ExtrudeGeometry, Float32BufferAttribute, Group, LineBasicMaterial, LineSegments, Mesh,
  MeshBasicMaterial, MeshLambertMaterial, PerspectiveCamera, PlaneGeometry, Scene, Shape, SphereGeometry,
  SRGBColorSpace, Vector3, WebGLRenderer,
} from "three";
export { Line2 } from "three/addons/lines/Line2.js";
export { LineGeometry } from "three/addons/lines/LineGeometry.js";
export { LineMaterial } from "three/addons/lines/LineMaterial.js";
export { OrbitControls } from "three/addons/controls/OrbitControls.js";
