// Where cameras stand, and how they move from one to the other. Offsets are from what they look at.
import { Vector3 } from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import { clamp } from "./mission.js";

export const CAMERAS = { chase: "Chase", side: "Beside", top: "From above", all: "Overview", free: "Free" };
const GLIDE_MS = 800;
const SMOOTHED_S = 4; // over which a camera that turns with a vehicle averages its heading
const FLOOR_CLEARANCE_M = 0.6;

const spot = new Vector3();
const target = new Vector3();
const smooth = (w) => w * w * (3 - 2 * w);

export class Cameras {
  constructor(mission, camera, canvas, changed, calm) {
    this.mission = mission;
    this.camera = camera;
    this.calm = calm;
    this.follow = mission.follow; // index of a vehicle, -1 for all
    this.time = mission.start;
    this.name = "free";
    this.ask = changed;
    this.controls = new OrbitControls(camera, canvas);
    this.controls.minDistance = 1.2;
    this.controls.maxDistance = 4000;
    this.controls.maxPolarAngle = Math.PI * 0.94;
    this.controls.zoomSpeed = 1.2;
    this.controls.rotateSpeed = 0.7;
    this.controls.addEventListener("start", () => {
      this.tween = null;
      this.dragging = true;
    });
    this.controls.addEventListener("end", () => {
      this.dragging = false;
      this.ask();
    });
    this.controls.addEventListener("change", () => this.ask());
    this.last = { target: new Vector3(), yaw: 0 };
  }

  start(time) {
    this.time = time;
    this.last.target.copy(this.target(new Vector3()));
    this.last.yaw = this.yaw();
    this.controls.target.copy(this.last.target);
  }

  get busy() {
    return Boolean(this.tween || this.glide || this.dragging);
  }

  /** What the camera looks at: a vehicle, or the middle of all, whose `radius` is set then. */
  target(out) {
    const { mission, time } = this;
    if (this.follow >= 0) return mission.pose(this.follow, time, out);
    const low = new Vector3(Infinity, Infinity, Infinity);
    const high = new Vector3(-Infinity, -Infinity, -Infinity);
    for (let v = 0; v < mission.count; v++) {
      mission.pose(v, time, spot);
      low.min(spot);
      high.max(spot);
    }
    for (const beacon of mission.beacons) {
      spot.fromArray(beacon);
      low.min(spot);
      high.max(spot);
    }
    this.radius = 0.5 * low.distanceTo(high) + 1.5;
    return out.copy(low).add(high).multiplyScalar(0.5);
  }

  yaw() {
    const turned = this.follow >= 0 ? this.follow : Math.max(this.mission.leader, 0);
    return this.mission.heading(turned, this.time, SMOOTHED_S);
  }

  /** The distance of the farthest vehicle from the target. */
  reach() {
    const middle = this.target(new Vector3());
    let reach = 0;
    for (let v = 0; v < this.mission.count; v++) {
      reach = Math.max(reach, this.mission.pose(v, this.time, spot).distanceTo(middle));
    }
    return reach + 2;
  }

  /** Offset of a named camera. */
  offset(name) {
    const yaw = this.yaw();
    const ahead = new Vector3(Math.sin(yaw), Math.cos(yaw), 0);
    const aside = new Vector3(ahead.y, -ahead.x, 0);
    const middle = this.target(new Vector3());
    const slope = Math.tan((this.camera.fov * Math.PI) / 360);
    const narrow = Math.min(1, this.camera.aspect);
    const out = new Vector3();
    if (name === "chase") return this.follow < 0 ? this.behindAll(out, ahead, aside, middle, slope) : this.behind(out, ahead, aside);
    if (name === "side") {
      const away = this.follow < 0 ? this.radius / slope : 4.4;
      return out.addScaledVector(aside, away).addScaledVector(ahead, 0.5).setZ(this.follow < 0 ? 0.12 * away : 0.7);
    }
    if (name === "top") {
      const reach = this.follow < 0 ? this.radius : 8;
      return out.set(0, -0.02, (1.15 * reach) / slope / narrow);
    }
    const far = (Math.max(this.reach(), 12) / slope) * (1.6 / Math.min(this.camera.aspect, 1.6));
    return out.set(-0.45 * far, -0.8 * far, 0.55 * far);
  }

  /** Behind and beside a formation, below the surface. */
  behindAll(out, ahead, aside, middle, slope) {
    const fit = this.radius / slope;
    out.addScaledVector(ahead, -0.6 * fit).addScaledVector(aside, 0.42 * fit);
    return out.setZ(Math.min(0.34 * fit, Math.max(6, -middle.z - 2.5)));
  }

  /** Behind and beside a vehicle, farther back where its estimate is far off, so that both are in the picture. */
  behind(out, ahead, aside) {
    const f = this.mission.followerOf[this.follow];
    const error = f >= 0 ? this.mission.error(f, this.time) || 0 : 0;
    out.addScaledVector(ahead, -4.5).addScaledVector(aside, 2.0).setZ(0.62);
    return out.multiplyScalar(1 + (0.12 * Math.min(error, 8)) / Math.min(1, this.camera.aspect));
  }

  use(name, now = false) {
    this.name = name;
    this.turning = name === "chase" || name === "side";
    if (name === "free") return;
    const from = this.camera.position.clone().sub(this.controls.target);
    const to = this.offset(name);
    this.tween = now || this.calm ? null : { from, to, began: performance.now() };
    if (!this.tween) this.camera.position.copy(this.controls.target).add(to);
    this.ask();
  }

  /** Look at another vehicle, or at all for -1; the camera glides there. */
  look(vehicle) {
    const before = this.last.target.clone();
    this.follow = vehicle;
    this.last.target.copy(this.target(target));
    this.last.yaw = this.yaw();
    this.glide = { from: before.sub(this.last.target), began: performance.now() };
    this.use(this.name);
  }

  move(now, time) {
    this.time = time;
    this.target(target);
    const { camera, controls } = this;
    const offset = camera.position.clone().sub(controls.target);
    const yaw = this.yaw();
    if (this.turning) offset.applyAxisAngle(camera.up, this.last.yaw - yaw);
    if (this.tween) {
      const w = clamp((now - this.tween.began) / GLIDE_MS, 0, 1);
      const { from, to } = this.tween;
      const length = from.length() * (1 - smooth(w)) + to.length() * smooth(w);
      offset.copy(from).lerp(to, smooth(w)).setLength(Math.max(length, 0.5));
      if (w >= 1) this.tween = null;
    }
    controls.target.copy(target);
    if (this.glide) {
      const w = this.calm ? 1 : clamp((now - this.glide.began) / GLIDE_MS, 0, 1);
      controls.target.addScaledVector(this.glide.from, 1 - smooth(w));
      if (w >= 1) this.glide = null;
    }
    camera.position.copy(controls.target).add(offset);
    const lowest = this.mission.floorAt(camera.position.x, camera.position.y) + FLOOR_CLEARANCE_M;
    if (camera.position.z < lowest) camera.position.z = lowest;
    this.last.target.copy(target);
    this.last.yaw = yaw;
    const ask = this.ask;
    this.ask = () => {}; // what follows is drawn at once
    controls.update();
    this.ask = ask;
    camera.updateMatrixWorld();
  }
}
