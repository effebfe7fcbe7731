// Trails, rays, rings, marks and discs. Lines are plain quads in one buffer: software renderers draw
// every instance of instanced geometry on its own, which takes most of a frame.
import {
  BufferAttribute, BufferGeometry, CircleGeometry, DynamicDrawUsage, InstancedBufferAttribute,
  InstancedMesh, Matrix4, Mesh, Points, Vector3,
} from "three";

const matrix = new Matrix4();
const scale = new Vector3();
const from = new Vector3();
const to = new Vector3();
const spot = new Vector3();

const MOST_POINTS = 2000; // of a trail before it is simplified
const ESTIMATE_M = 0.08; // by how much a simplified trail may be off [m]
const TRUTH_M = 0.03;

/** A mesh of segments: two triangles each, with both ends at all four corners. */
function segments(capacity, material) {
  const geometry = new BufferGeometry();
  const corners = new Float32Array(12 * capacity);
  const index = new Uint32Array(6 * capacity);
  for (let i = 0; i < capacity; i++) {
    corners.set([0, -1, 0, 1, -1, 0, 0, 1, 0, 1, 1, 0], 12 * i);
    index.set([0, 1, 2, 2, 1, 3].map((corner) => 4 * i + corner), 6 * i);
  }
  geometry.setAttribute("position", new BufferAttribute(corners, 3));
  geometry.setIndex(new BufferAttribute(index, 1));
  geometry.setAttribute("a", new BufferAttribute(new Float32Array(16 * capacity), 4));
  geometry.setAttribute("b", new BufferAttribute(new Float32Array(16 * capacity), 4));
  geometry.setAttribute("hue", new BufferAttribute(new Uint8Array(16 * capacity), 4, true));
  const mesh = new Mesh(geometry, material);
  mesh.frustumCulled = false;
  return mesh;
}

/** Write segment i; ends have four numbers, colours red, green, blue and alpha. */
function put(mesh, i, first, last, colour) {
  const { a, b, hue } = mesh.geometry.attributes;
  for (let corner = 0; corner < 4; corner++) {
    const at = 16 * i + 4 * corner;
    for (let c = 0; c < 4; c++) {
      a.array[at + c] = first[c];
      b.array[at + c] = last[c];
      hue.array[at + c] = 255 * colour[c];
    }
  }
}

/** Points (x, y, z, t) without those that steady, straight motion between others has within a tolerance. */
function simplify(points, tolerance) {
  const stays = new Uint8Array(points.length);
  stays[0] = 1;
  stays[points.length - 1] = 1;
  const stretches = [[0, points.length - 1]];
  while (stretches.length) {
    const [i, j] = stretches.pop();
    const p = points[i];
    const q = points[j];
    let farthest = -1;
    let worst = tolerance;
    for (let k = i + 1; k < j; k++) {
      const w = (points[k][3] - p[3]) / (q[3] - p[3]);
      const off = Math.hypot(
        p[0] + (q[0] - p[0]) * w - points[k][0],
        p[1] + (q[1] - p[1]) * w - points[k][1],
        p[2] + (q[2] - p[2]) * w - points[k][2],
      );
      if (off > worst) {
        worst = off;
        farthest = k;
      }
    }
    if (farthest > 0) {
      stays[farthest] = 1;
      stretches.push([i, farthest], [farthest, j]);
    }
  }
  return points.filter((_, i) => stays[i]);
}

/** Routes of whole missions, of which only what is past is drawn: `routes` are {at(t), colour, tolerance}. */
export class Trails {
  constructor(mission, routes, material, least) {
    const step = Math.max(least, (mission.end - mission.start) / MOST_POINTS);
    this.pieces = [];
    for (const route of routes) {
      const points = [];
      for (let t = mission.start; t <= mission.end + 1e-6; t += step) {
        const p = route.at(t);
        if (p) points.push([p.x, p.y, p.z, t]);
      }
      const corners = points.length > 1 ? simplify(points, route.tolerance) : [];
      for (let i = 1; i < corners.length; i++) this.pieces.push([corners[i - 1], corners[i], route.colour]);
    }
    this.pieces.sort((piece, next) => piece[0][3] - next[0][3]);
    this.mesh = segments(this.pieces.length, material);
    this.pieces.forEach((piece, i) => put(this.mesh, i, ...piece));
  }

  until(t) {
    let low = 0;
    let high = this.pieces.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.pieces[middle][0][3] <= t) low = middle + 1;
      else high = middle;
    }
    this.mesh.geometry.setDrawRange(0, 6 * low);
  }
}

/** True routes of all vehicles. */
export function truthTrails(mission, hues, material) {
  const routes = [];
  mission.vehicles.forEach((vehicle, v) => {
    const leads = vehicle.role === "leader";
    if (!leads && !mission.truth) return;
    const at = leads ? (t) => mission.pose(v, t, spot) : (t) => mission.site(v, vehicle.hydrophone, t, spot);
    routes.push({ at, colour: [...(leads ? hues.leader : hues.truth), 1], tolerance: TRUTH_M });
  });
  return new Trails(mission, routes, material, 0.5);
}

export function estimateTrails(mission, followers, hues, material) {
  const routes = followers.map((f) => (
    { at: (t) => mission.estimate(f, t, spot), colour: [...hues.estimate, 0.85], tolerance: ESTIMATE_M }
  ));
  return new Trails(mission, routes, material, 1);
}

/** Lines that change from frame to frame. */
export class Pen {
  constructor(capacity, material) {
    this.mesh = segments(capacity, material);
    this.attributes = ["a", "b", "hue"].map((name) => this.mesh.geometry.attributes[name]);
    for (const attribute of this.attributes) attribute.setUsage(DynamicDrawUsage);
    this.capacity = capacity;
    this.used = 0;
  }

  /** `width` in pixels; `dash` is the length of a dash [m], 0 for a whole line. */
  line(start, end, colour, alpha, width, dash = 0) {
    if (this.used >= this.capacity) return;
    put(this.mesh, this.used, [start.x, start.y, start.z, width], [end.x, end.y, end.z, dash], [...colour, alpha]);
    this.used++;
  }

  /** A level ellipse; of a dashed one every second stretch is left out. */
  ring(centre, { major, minor, angle }, colour, alpha, width, dashed = false) {
    const cosine = Math.cos(angle);
    const sine = Math.sin(angle);
    const corners = 40;
    for (let i = 0; i <= corners; i++) {
      const x = major * Math.cos((2 * Math.PI * i) / corners);
      const y = minor * Math.sin((2 * Math.PI * i) / corners);
      to.set(centre.x + cosine * x - sine * y, centre.y + sine * x + cosine * y, centre.z);
      if (i > 0 && !(dashed && i % 2)) this.line(from, to, colour, alpha, width);
      from.copy(to);
    }
  }

  done() {
    this.mesh.geometry.setDrawRange(0, 6 * this.used);
    for (const attribute of this.attributes) {
      attribute.clearUpdateRanges();
      attribute.addUpdateRange(0, 16 * this.used);
      attribute.needsUpdate = true;
    }
    this.used = 0;
  }
}

export const DISC = 0;
export const DIAMOND = 1;

/** Marks of a fixed size on the screen. */
export class Marks {
  constructor(capacity, material) {
    this.geometry = new BufferGeometry();
    for (const [name, size] of [["position", 3], ["hue", 4], ["form", 2]]) {
      const attribute = new BufferAttribute(new Float32Array(size * capacity), size);
      this.geometry.setAttribute(name, attribute.setUsage(DynamicDrawUsage));
    }
    this.mesh = new Points(this.geometry, material);
    this.mesh.frustumCulled = false;
    this.capacity = capacity;
    this.used = 0;
  }

  add(at, colour, alpha, shape, size) {
    if (this.used >= this.capacity) return;
    const { position, hue, form } = this.geometry.attributes;
    position.setXYZ(this.used, at.x, at.y, at.z);
    hue.setXYZW(this.used, ...colour, alpha);
    form.setXY(this.used, shape, size);
    this.used++;
  }

  done() {
    this.geometry.setDrawRange(0, this.used);
    for (const attribute of Object.values(this.geometry.attributes)) attribute.needsUpdate = true;
    this.used = 0;
  }
}

/** Level discs: shadows on the floor (soft, alpha below zero) and grounds of ellipses. */
export class Discs {
  constructor(capacity, material) {
    this.mesh = new InstancedMesh(new CircleGeometry(1, 32), material, capacity);
    this.hue = new InstancedBufferAttribute(new Float32Array(4 * capacity), 4).setUsage(DynamicDrawUsage);
    this.mesh.geometry.setAttribute("hue", this.hue);
    this.mesh.frustumCulled = false;
    this.capacity = capacity;
    this.used = 0;
  }

  add(x, y, z, { major, minor, angle }, colour, alpha) {
    if (this.used >= this.capacity) return;
    matrix.makeRotationZ(angle).scale(scale.set(major, minor, 1)).setPosition(x, y, z);
    this.mesh.setMatrixAt(this.used, matrix);
    this.hue.setXYZW(this.used, ...colour, alpha);
    this.used++;
  }

  done() {
    this.mesh.count = this.used;
    this.mesh.instanceMatrix.needsUpdate = true;
    this.hue.needsUpdate = true;
    this.used = 0;
  }
}
