// The picture: sea, hulls, trails, rays, ellipses and stations at one time, drawn with three.js.
import {
  AdditiveBlending, BufferAttribute, BufferGeometry, DoubleSide, Mesh, PerspectiveCamera, PlaneGeometry, Points,
  Quaternion, Scene, ShaderMaterial, Vector2, Vector3, WebGLRenderer,
} from "three";
import { Cameras } from "./cameras.js";
import { Fleet } from "./hulls.js";
import { DIAMOND, DISC, Discs, Marks, Pen, estimateTrails, truthTrails } from "./lines.js";
import { clamp } from "./mission.js";
import { BACKDROP, BLOTS, FLOOR, HULL, LINES, MARKS, SHAFTS, SNOW, SURFACE, seaTexture } from "./sea.js";

export const USED = [0.35, 1, 0.55];
export const REFUSED = [1, 0.22, 0.16];
const TRANSMITTER = [0.95, 0.97, 1];
const SHADOW = [0, 0.04, 0.06];
const AFTERGLOW_S = 0.45; // of a ray, in seconds as they pass for a viewer
const TRAIL_S = 60; // time constant of a trail's fading
const SIGMAS = 2;
const LATEST_PIECES = 6; // of a route since trails were drawn
const CROWD = 12; // followers beyond which only the followed one's estimate is drawn, and rays are faint
const BEYOND_M = 8000; // of a floor, behind its edge
const REST_MS = 900; // after which software renderers draw a sharper picture
const SHARPNESS = [0.7, 1, 2]; // most pixels of the picture per pixel of the page, by quality

export const css = (colour, alpha = 1) => `rgb(${colour.map((v) => Math.round(255 * v)).join(" ")} / ${alpha})`;
export const calm = matchMedia("(prefers-reduced-motion: reduce)").matches;

const spot = new Vector3();

function shader(source, uniforms, settings = {}) {
  return new ShaderMaterial({ ...source, uniforms, ...settings });
}

/** A floor that is not level, and goes on level beyond what is known of it. */
function relief(mission) {
  const { west, east, south, north, points } = mission.seabed;
  const ticks = (low, high) => [
    low - BEYOND_M, ...Array.from({ length: points }, (_, i) => low + ((high - low) * i) / (points - 1)), high + BEYOND_M,
  ];
  const xs = ticks(west, east);
  const ys = ticks(south, north);
  const geometry = new PlaneGeometry(1, 1, xs.length - 1, ys.length - 1);
  const place = geometry.attributes.position;
  // rows of a plane run from north to south
  ys.reverse().forEach((y, row) => xs.forEach((x, column) => {
    place.setXYZ(row * xs.length + column, x, y, mission.floorAt(x, y));
  }));
  geometry.computeVertexNormals();
  return geometry;
}

/** The name of the graphics card; throws where there is no WebGL 2. */
function cardName() {
  const context = document.createElement("canvas").getContext("webgl2");
  if (!context) throw new Error("no WebGL");
  const info = context.getExtension("WEBGL_debug_renderer_info");
  const name = info ? context.getParameter(info.UNMASKED_RENDERER_WEBGL) : "";
  context.getExtension("WEBGL_lose_context")?.loseContext();
  return name;
}

export class View {
  /** `quality` 0 … 2, chosen by the graphics card if it is undefined. */
  constructor(mission, canvas, quality) {
    this.mission = mission;
    this.canvas = canvas;
    this.card = cardName();
    this.software = /swiftshader|llvmpipe|software|basic render/i.test(this.card);
    this.quality = quality ?? (this.software ? 0 : 2);
    this.fixed = quality !== undefined;
    this.coarse = 1; // share of the usual pixels, less where even the lowest quality is slow
    this.renderer = new WebGLRenderer({
      canvas, antialias: this.quality > 1, powerPreference: "high-performance", stencil: false,
    });
    this.scene = new Scene();
    this.camera = new PerspectiveCamera(46, 16 / 9, 0.1, 2000);
    this.camera.up.set(0, 0, 1);
    this.ask = () => {};
    this.cameras = new Cameras(mission, this.camera, canvas, () => this.ask(), calm);
    this.poses = mission.vehicles.map(() => ({ position: new Vector3(), quaternion: new Quaternion() }));
    this.labels = [];
    this.size = 1;
    this.trueSize = false;
    this.time = mission.start;
    this.build();
  }

  get follow() {
    return this.cameras.follow;
  }

  get crowded() {
    return this.mission.followers > CROWD;
  }

  /** The follower whose estimate, rays and numbers stand in front: the followed one, or the only one. */
  get filmed() {
    if (this.follow >= 0) return this.mission.followerOf[this.follow];
    return this.mission.followers === 1 ? 0 : -1;
  }

  build() {
    const { scene, mission } = this;
    const rich = this.quality > 0;
    this.uniforms = {
      noise: { value: seaTexture(rich ? 512 : 256, rich ? 8 : 2) },
      sight: { value: new Vector2(60, 150) },
      wave: { value: 0 },
      pixel: { value: new Vector2() },
      now: { value: 0 },
      grid: { value: 10 },
      strength: { value: 0.4 },
      span: { value: 24 },
      pixels: { value: 1 },
      width: { value: 3.2 },
      fade: { value: TRAIL_S },
    };
    this.buildSea(rich);
    const paint = shader(HULL, this.uniforms, { side: DoubleSide });
    this.fleets = [];
    mission.models.forEach((model, m) => {
      for (const role of ["leader", "follower"]) {
        const members = mission.vehicles.flatMap((vehicle, v) => (vehicle.model === m && vehicle.role === role ? [v] : []));
        const colour = role === "leader" ? mission.hues.leader : mission.hues.truth;
        if (members.length) this.fleets.push(new Fleet(mission, model, members, colour, paint, scene));
      }
    });
    const overlay = { transparent: true, depthWrite: false };
    this.trailPaint = shader({ ...LINES, defines: { TRAIL: 1 } }, this.uniforms, { ...overlay, side: DoubleSide });
    const count = mission.count + mission.beacons.length;
    this.pen = new Pen(Math.min(mission.followers * 110, 3000) + 400, shader(LINES, this.uniforms, { ...overlay, side: DoubleSide }));
    this.marks = new Marks(2 * count + 40, shader(MARKS, this.uniforms, { ...overlay, depthTest: false }));
    this.discs = new Discs(2 * count + 16, shader(BLOTS, this.uniforms, { ...overlay, side: DoubleSide }));
    this.truth = truthTrails(mission, mission.hues, this.trailPaint);
    [this.discs, this.truth, this.pen, this.marks].forEach((layer, i) => {
      layer.mesh.renderOrder = 6 + i;
      scene.add(layer.mesh);
    });
    this.drawEstimates();
  }

  buildSea(rich) {
    const { scene, uniforms } = this;
    const add = (object, order) => {
      object.frustumCulled = false;
      object.renderOrder = order;
      scene.add(object);
      return object;
    };
    const overlay = { transparent: true, depthWrite: false };
    const plane = new PlaneGeometry(2, 2);
    const screen = new BufferGeometry();
    screen.setAttribute("position", new BufferAttribute(new Float32Array([-1, -1, 0, 3, -1, 0, -1, 3, 0]), 3));
    const defines = { ...(rich && { RICH: 1 }), ...(this.mission.seabed && { RELIEF: 1 }) };
    const ground = this.mission.seabed ? relief(this.mission) : plane;
    this.floor = add(new Mesh(ground, shader(FLOOR, uniforms, { defines })), 1);
    this.surface = add(new Mesh(plane, shader(SURFACE, uniforms, { side: DoubleSide })), 1);
    add(new Mesh(screen, shader(BACKDROP, uniforms, { depthWrite: false })), 2);
    const light = shader(SHAFTS, uniforms, { ...overlay, blending: AdditiveBlending, depthTest: false });
    this.shafts = add(new Mesh(screen, light), 3);
    const specks = new BufferGeometry();
    specks.setAttribute("position", new BufferAttribute(new Float32Array(1500).map(() => Math.random()), 3));
    this.snow = add(new Points(specks, shader(SNOW, uniforms, overlay)), 4);
  }

  /** Draw trails anew, of a mission that has gone on. */
  grow() {
    this.scene.remove(this.truth.mesh);
    this.truth.mesh.geometry.dispose();
    this.truth = truthTrails(this.mission, this.mission.hues, this.trailPaint);
    this.truth.mesh.renderOrder = 7;
    this.scene.add(this.truth.mesh);
    this.estimatesOf = undefined;
    this.drawEstimates();
    this.trailsEnd = this.mission.end;
  }

  /** True routes since trails were drawn. */
  drawLatest() {
    const { mission, time, trailsEnd } = this;
    if (!(time > trailsEnd)) return;
    mission.vehicles.forEach((vehicle, v) => {
      const hue = v === mission.leader ? mission.hues.leader : mission.hues.truth;
      const at = (t) => mission.site(v, v === mission.leader ? null : vehicle.hydrophone, t, new Vector3());
      let before = at(trailsEnd);
      for (let i = 1; i <= LATEST_PIECES; i++) {
        const next = at(trailsEnd + ((time - trailsEnd) * i) / LATEST_PIECES);
        this.pen.line(before, next, hue, 1, this.uniforms.width.value);
        before = next;
      }
    });
  }

  /** Trails of estimates: of all, in a crowd of the followed vehicle alone. */
  drawEstimates() {
    const { mission } = this;
    const everyone = [...Array(mission.followers).keys()];
    const shown = this.crowded ? everyone.filter((f) => f === this.filmed) : everyone;
    const key = shown.join();
    if (key === this.estimatesOf) return;
    this.estimatesOf = key;
    if (this.estimates) {
      this.scene.remove(this.estimates.mesh);
      this.estimates.mesh.geometry.dispose();
    }
    this.estimates = estimateTrails(mission, shown, mission.hues, this.trailPaint);
    this.estimates.mesh.renderOrder = 5;
    this.scene.add(this.estimates.mesh);
  }

  look(vehicle) {
    this.cameras.look(vehicle);
    this.drawEstimates();
  }

  resize(busy, now) {
    if (busy) this.moved = now;
    const still = this.software && now - (this.moved ?? 0) > REST_MS;
    const quality = still ? Math.max(1, this.quality) : this.quality;
    const ratio = Math.min(SHARPNESS[quality], quality < 2 ? 1 : devicePixelRatio) * (still ? 1 : this.coarse);
    const box = this.canvas.parentElement.getBoundingClientRect();
    const width = Math.max(Math.round(box.width), 1);
    const height = Math.max(Math.round(box.height), 1);
    this.sharp = still || !this.software;
    if (this.width === width && this.height === height && this.ratio === ratio) return;
    Object.assign(this, { width, height, ratio });
    this.renderer.setPixelRatio(ratio);
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
  }

  /** Draw a time; `turned` seconds have passed for the viewer since the last frame, at `speed` seconds of mission each. */
  draw(now, { turned, speed, sea, busy }) {
    const { mission, time, camera } = this;
    this.resize(busy || this.cameras.busy, now);
    this.cameras.move(now, time);
    const eye = camera.position;
    const away = eye.distanceTo(this.cameras.controls.target);
    this.setUniforms(eye, away, speed, sea);
    this.truth.until(time);
    this.estimates.until(time);
    this.metres = (2 * away * Math.tan((camera.fov * Math.PI) / 360)) / this.height; // of a pixel
    this.size = this.hullSize();
    this.poses.forEach((pose, v) => mission.pose(v, time, pose.position, pose.quaternion));
    for (const fleet of this.fleets) fleet.place(this.poses, this.size, time, turned);
    this.annotate(speed);
    this.renderer.render(this.scene, camera);
  }

  setUniforms(eye, away, speed, sea) {
    const { mission, uniforms, camera } = this;
    uniforms.sight.value.set(Math.max(58, 1.1 * away), Math.max(190, 3.4 * away));
    camera.near = clamp(away / 25, 0.1, 6);
    camera.far = 4 * uniforms.sight.value.y;
    camera.updateProjectionMatrix();
    uniforms.wave.value = sea;
    uniforms.now.value = this.time;
    uniforms.pixel.value.set(2 / this.width, 2 / this.height);
    uniforms.pixels.value = this.ratio;
    uniforms.span.value = clamp(1.6 * away, 14, 60);
    const squares = Math.max(away, eye.z - mission.floor) / 12;
    uniforms.grid.value = [2, 10, 20, 100].find((grid) => grid > squares) ?? 200;
    uniforms.fade.value = Math.max(TRAIL_S, 3 * speed);
    const span = 1.3 * uniforms.sight.value.y;
    if (!mission.seabed) {
      this.floor.position.set(eye.x, eye.y, mission.floor);
      this.floor.scale.setScalar(span);
    }
    this.surface.position.set(eye.x, eye.y, 0);
    this.surface.scale.setScalar(span);
    const below = eye.z < -0.05;
    this.surface.visible = below;
    this.shafts.visible = below && (this.quality > 1 || (this.software && this.sharp));
    this.snow.visible = below && (this.quality > 0 || this.sharp);
    uniforms.strength.value = 0.36 * clamp(1.1 + eye.z / 45, 0.35, 1);
  }

  /** Hulls that are small on the screen are drawn larger, all by one factor that the page states. */
  hullSize() {
    const longest = Math.max(...this.fleets.map((fleet) => fleet.length));
    const pixels = this.crowded ? 40 : this.mission.count > 2 ? 62 : 48;
    const wanted = clamp((pixels * this.metres) / longest, 1, 12);
    if (this.trueSize || wanted < 1.3) return 1;
    return wanted > 6 ? Math.round(wanted) : Math.round(wanted * 2) / 2;
  }

  annotate(speed) {
    const { mission, time, pen, marks, discs } = this;
    this.labels = [];
    this.drawLatest();
    mission.vehicles.forEach((vehicle, v) => {
      this.drawShadow(v);
      if (v === mission.leader) {
        this.labels.push({ key: `${v}`, v, at: this.poses[v].position.clone(), words: vehicle.name, colour: mission.hues.leader });
      }
    });
    const transmitters = mission.leader < 0 ? [] : mission.vehicles[mission.leader].transmitters.slice(0, mission.used)
      .map((offset) => mission.site(mission.leader, offset, time, new Vector3()));
    for (let f = 0; f < mission.followers; f++) this.drawFollower(f, transmitters, speed);
    mission.beacons.forEach((beacon, b) => {
      spot.fromArray(beacon);
      marks.add(spot, mission.hues.leader, 1, DIAMOND, 12);
      pen.line(spot, new Vector3(spot.x, spot.y, mission.floorAt(spot.x, spot.y)), mission.hues.leader, 0.35, 4);
      this.labels.push({ key: `b${b}`, v: -2, at: spot.clone(), words: `transmitter ${b + 1}`, colour: mission.hues.leader });
    });
    if (this.metres < 0.06) for (const at of transmitters) marks.add(at, TRANSMITTER, 1, DISC, 8);
    pen.done();
    marks.done();
    discs.done();
  }

  drawShadow(v) {
    const { mission } = this;
    const fleet = this.fleets.find((candidate) => candidate.members.includes(v));
    const { position } = this.poses[v];
    const ground = mission.floorAt(position.x, position.y);
    const high = position.z - ground;
    const shape = {
      major: this.size * (0.5 * fleet.length + 0.05 * high),
      minor: this.size * (0.14 + 0.05 * high),
      angle: Math.PI / 2 - mission.heading(v, this.time),
    };
    this.discs.add(position.x, position.y, ground + 0.02, shape, SHADOW, -0.62 / (1 + 0.02 * high));
  }

  drawFollower(f, transmitters, speed) {
    const { mission, time, metres, marks } = this;
    const v = mission.vehicleOf[f];
    const vehicle = mission.vehicles[v];
    const filmed = f === this.filmed;
    const hydrophone = mission.hydrophone(f, time, new Vector3());
    this.labels.push({ key: `${v}`, v, at: hydrophone, words: vehicle.name, colour: mission.hues.truth });
    if (vehicle.station !== null) {
      const place = mission.mix("station", 2 * mission.followers, mission.slow_hz, time, 2 * f, 2);
      const radius = 0.62 * this.size * this.fleets[0].length;
      spot.set(place[0], place[1], vehicle.station);
      this.pen.ring(spot, { major: radius, minor: radius, angle: 0 }, mission.hues.station, filmed ? 0.9 : 0.6, 5, true);
    }
    this.drawRays(f, transmitters, hydrophone, filmed, speed);
    if (!this.crowded || filmed) this.drawEstimate(f, hydrophone, filmed);
    if (mission.truth && (filmed || metres < 0.03)) marks.add(hydrophone, mission.hues.truth, 1, DISC, filmed ? 9 : 7);
  }

  /** Rays of the last message: green, or red where it was rejected, dashed where nothing was received. */
  drawRays(f, transmitters, hydrophone, filmed, speed) {
    const { mission, time, metres } = this;
    const m = mission.lastMessage(f, time);
    if (m < 0) return;
    const { time: times, kind, range, source } = mission.messages[f];
    const age = (time - times[m]) / Math.max(speed, 1);
    const glow = Math.exp(-age / AFTERGLOW_S) * (filmed ? 1 : this.crowded ? 0.16 : 0.55);
    if (glow < 0.04) return;
    const refused = mission.refusedKinds.includes(kind[m]);
    for (let i = 0; i < mission.used; i++) {
      let at = transmitters[i];
      if (mission.beacons.length) {
        const beacon = mission.beacons[source[3 * m + i] - 1];
        at = beacon && spot.fromArray(beacon);
      }
      if (!at) continue;
      const heard = range[3 * m + i] > 0;
      const dash = heard ? 0 : Math.max(0.4, 14 * metres);
      this.pen.line(at, hydrophone, heard && !refused ? USED : REFUSED, glow, filmed ? 9 : this.crowded ? 4 : 6, dash);
    }
  }

  drawEstimate(f, hydrophone, filmed) {
    const { mission, time, metres, pen, marks, discs } = this;
    const v = mission.vehicleOf[f];
    const colour = mission.hues.estimate;
    const estimate = mission.estimate(f, time, new Vector3());
    if (!estimate) return;
    const branches = mission.hypotheses(f, time);
    for (const branch of branches) {
      spot.set(branch.x, branch.y, estimate.z);
      const shape = this.twoSigma(branch);
      discs.add(spot.x, spot.y, spot.z, shape, colour, 0.25 * branch.weight);
      pen.ring(spot, shape, colour, 0.25 + 0.7 * branch.weight, 4);
      if (filmed) {
        const words = `hypothesis, weight ${branch.weight.toFixed(2)}`;
        this.labels.push({ key: `${v}h${branches.indexOf(branch)}`, v, at: spot.clone(), words, colour });
      }
    }
    const ellipse = mission.ellipse(f, time);
    if (!branches.length && SIGMAS * ellipse.major > 5 * metres) {
      const shape = this.twoSigma(ellipse);
      discs.add(estimate.x, estimate.y, estimate.z, shape, colour, filmed ? 0.2 : 0.13);
      pen.ring(estimate, shape, colour, filmed ? 0.95 : 0.6, 5);
    }
    marks.add(estimate, colour, 1, DIAMOND, filmed ? 14 : 8);
    if (!mission.truth) return;
    const off = mission.error(f, time);
    if (off > 6 * metres) pen.line(hydrophone, estimate, colour, 1, 7, Math.max(0.06, 11 * metres));
    if (filmed) {
      const words = `estimate, off by ${off.toFixed(off < 10 ? 2 : 1)} m`;
      this.labels.push({ key: `${v}e`, v, at: estimate, words, colour, below: true });
    }
  }

  /** The 2σ ellipse, at least so wide that it can be seen. */
  twoSigma({ major, minor, angle }) {
    return { major: SIGMAS * major, minor: Math.max(SIGMAS * minor, 0.6 * this.metres), angle };
  }
}
