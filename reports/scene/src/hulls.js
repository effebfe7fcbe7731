// Hulls of vehicles as the film has them, with moving fins and propellers.
import {
  BoxGeometry, BufferAttribute, BufferGeometry, CapsuleGeometry, CylinderGeometry, DynamicDrawUsage,
  InstancedMesh, Matrix4, Quaternion, SphereGeometry, Vector3,
} from "three";
import { toCreasedNormals } from "three/examples/jsm/utils/BufferGeometryUtils.js";

const STEEL = [0.2, 0.21, 0.23, 0.6]; // red, green, blue, shine
const BRONZE = [0.62, 0.5, 0.28, 0.8];
const body = new Matrix4();
const local = new Matrix4();
const scale = new Vector3();

/** The geometry of a geom of MuJoCo, whose axis is z where that of three.js is y. */
function geometryOf(part) {
  const [a, b, c] = part.size;
  const upright = (geometry) => geometry.rotateX(Math.PI / 2);
  // bands lie half a millimetre above the hull, too little for a depth buffer
  const radius = part.name.startsWith("band") ? 1.012 * a : a;
  switch (part.kind) {
    case "cylinder":
      return upright(new CylinderGeometry(radius, radius, 2 * b, a > 0.06 ? 28 : 14));
    case "capsule":
      return upright(new CapsuleGeometry(a, 2 * b, 4, a > 0.03 ? 18 : 8));
    case "box":
      return new BoxGeometry(2 * a, 2 * b, 2 * c);
    case "sphere":
      return new SphereGeometry(a, 24, 16);
    case "ellipsoid":
      return new SphereGeometry(1, 28, 14).applyMatrix4(new Matrix4().makeScale(a, b, c));
    default: {
      const mesh = new BufferGeometry();
      mesh.setAttribute("position", new BufferAttribute(new Float32Array(part.points), 3));
      mesh.setIndex(part.faces);
      return toCreasedNormals(mesh, 0.7);
    }
  }
}

/** One geometry of many, each with a place and a paint. */
function merge(pieces) {
  const position = [];
  const normal = [];
  const tint = [];
  const index = [];
  for (const { geometry, matrix, paint } of pieces) {
    geometry.applyMatrix4(matrix);
    const first = position.length / 3;
    const points = geometry.attributes.position.count;
    const corners = geometry.index ? Array.from(geometry.index.array) : [...Array(points).keys()];
    position.push(...geometry.attributes.position.array);
    normal.push(...geometry.attributes.normal.array);
    index.push(...corners.map((i) => first + i));
    for (let i = 0; i < points; i++) tint.push(...paint);
  }
  const whole = new BufferGeometry();
  whole.setAttribute("position", new BufferAttribute(new Float32Array(position), 3));
  whole.setAttribute("normal", new BufferAttribute(new Float32Array(normal), 3));
  whole.setAttribute("tint", new BufferAttribute(new Float32Array(tint), 4));
  whole.setIndex(index);
  return whole;
}

function placeOf(part) {
  const [w, x, y, z] = part.turn;
  return new Matrix4().compose(new Vector3(...part.at), new Quaternion(x, y, z, w), new Vector3(1, 1, 1));
}

function propellerGeometry(radius) {
  const hub = new Matrix4().makeScale(0.34 * radius, 0.2 * radius, 0.2 * radius);
  const pieces = [{ geometry: new SphereGeometry(1, 10, 6), matrix: hub, paint: STEEL }];
  for (let blade = 0; blade < 3; blade++) {
    const matrix = new Matrix4().makeRotationX((2 * Math.PI * blade) / 3);
    matrix.multiply(new Matrix4().makeTranslation(0, 0, 0.55 * radius));
    matrix.multiply(new Matrix4().makeRotationZ(0.6));
    matrix.multiply(new Matrix4().makeScale(0.03 * radius, 0.26 * radius, 0.46 * radius));
    pieces.push({ geometry: new SphereGeometry(1, 8, 5), matrix, paint: BRONZE });
  }
  return merge(pieces);
}

/** The vehicles of one model and role: instances of its hull, fins and propellers. */
export class Fleet {
  /** `colour` is that of the role: it paints the bands, so that equal hulls of two roles can be told apart. */
  constructor(mission, model, members, colour, material, scene) {
    this.mission = mission;
    this.members = members;
    this.meshes = [];
    const add = (geometry) => {
      const mesh = new InstancedMesh(geometry, material, members.length);
      mesh.frustumCulled = false;
      mesh.instanceMatrix.setUsage(DynamicDrawUsage);
      scene.add(mesh);
      this.meshes.push(mesh);
      return mesh;
    };
    const paintOf = (part) => (part.name.startsWith("band") ? [...colour, 0.3] : [...part.rgb, part.shine]);
    const moving = new Set(model.fins.map((fin) => fin.part));
    const fixed = model.parts.filter((part) => !moving.has(part.name));
    this.hull = add(merge(fixed.map((part) => (
      { geometry: geometryOf(part), matrix: placeOf(part), paint: paintOf(part) }
    ))));
    this.hull.geometry.computeBoundingBox();
    const { min, max } = this.hull.geometry.boundingBox;
    this.length = max.x - min.x;
    this.fins = model.fins.map((fin) => {
      const part = model.parts.find((candidate) => candidate.name === fin.part);
      const centred = { ...part, at: [0, 0, 0] };
      const geometry = merge([{ geometry: geometryOf(part), matrix: placeOf(centred), paint: paintOf(part) }]);
      return { ...fin, at: part.at, axis: new Vector3(...fin.axis), mesh: add(geometry) };
    });
    this.propellers = model.propellers.map((propeller) => ({
      ...propeller,
      mesh: add(propellerGeometry(propeller.radius)),
      axis: new Vector3(1, 0, 0),
      angles: members.map((v) => v),
    }));
  }

  /** Bring everything to where it is; `turned` are seconds since the last frame as they pass for a viewer. */
  place(poses, size, t, turned) {
    const { mission } = this;
    this.members.forEach((v, i) => {
      body.compose(poses[v].position, poses[v].quaternion, scale.setScalar(size));
      this.hull.setMatrixAt(i, body);
      for (const fin of this.fins) {
        local.makeRotationAxis(fin.axis, mission.effector(v, fin.column, t)).setPosition(...fin.at);
        fin.mesh.setMatrixAt(i, local.premultiply(body));
      }
      for (const propeller of this.propellers) {
        const state = mission.effector(v, propeller.column, t);
        // its real rate would flicker on a screen: a tenth of its revolutions, or by the root of its thrust
        const rate = propeller.spins ? 0.6 * state : 2.2 * Math.sign(state) * Math.sqrt(Math.abs(state));
        propeller.angles[i] += turned * rate;
        local.makeRotationAxis(propeller.axis, propeller.angles[i]).setPosition(...propeller.at);
        propeller.mesh.setMatrixAt(i, local.premultiply(body));
      }
    });
    for (const mesh of this.meshes) mesh.instanceMatrix.needsUpdate = true;
  }
}
