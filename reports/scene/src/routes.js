// The routes from above, north up. Without WebGL this map takes the place of the scene.
import { Quaternion, Vector3 } from "three";
import { fitted, roundStep } from "./drawing.js";
import { css } from "./view.js";

const EDGE = 14;
const LEAST_SPAN_M = 20;
const STEPS = 600; // points of a route
const point = new Vector3();
const turn = new Quaternion();

export class RouteMap {
  constructor(mission, canvas) {
    this.mission = mission;
    this.canvas = canvas;
    this.still = document.createElement("canvas");
  }

  /** Draw what does not change; `whole` where the map takes the place of the scene. */
  layout(whole) {
    const { mission, still, canvas } = this;
    Object.assign(this, fitted(canvas));
    const [west, south, east, north] = this.extent();
    const high = this.height - 2 * EDGE - (whole ? 60 : 12);
    this.zoom = Math.min((this.width - 2 * EDGE) / Math.max(east - west, LEAST_SPAN_M), high / Math.max(north - south, LEAST_SPAN_M));
    this.x0 = this.width / 2 - (this.zoom * (west + east)) / 2;
    this.y0 = this.height / 2 + (whole ? -15 : 5) + (this.zoom * (south + north)) / 2;
    still.width = canvas.width;
    still.height = canvas.height;
    const pen = still.getContext("2d");
    pen.scale(devicePixelRatio, devicePixelRatio);
    const { hues } = mission;
    for (let f = 0; f < mission.followers; f++) this.route(pen, (t) => mission.estimate(f, t, point), css(hues.estimate, 0.55), 0.8);
    for (let v = mission.count - 1; v >= 0; v--) {
      const leads = v === mission.leader;
      if (!leads && !mission.truth) continue;
      this.route(pen, (t) => mission.pose(v, t, point, turn), css(leads ? hues.leader : hues.truth, 0.9), leads ? 1.4 : 0.8);
    }
    pen.fillStyle = css(hues.leader);
    for (const [x, y] of mission.beacons) pen.fillRect(...this.to({ x, y }).map((place) => place - 3), 6, 6);
    this.scale(pen, whole);
  }

  extent() {
    const { mission } = this;
    const { position, estimate } = mission.array;
    let [west, south, east, north] = [Infinity, Infinity, -Infinity, -Infinity];
    const take = (x, y) => {
      west = Math.min(west, x);
      east = Math.max(east, x);
      south = Math.min(south, y);
      north = Math.max(north, y);
    };
    for (let i = 0; i < position.length; i += 3) take(position[i], position[i + 1]);
    const first = mission.known.map((t) => Math.ceil((t - mission.start) * mission.hz));
    for (let i = 0; i < estimate.length; i += 2) {
      const f = (i / 2) % mission.followers;
      if (Math.floor(i / (2 * mission.followers)) > first[f]) take(estimate[i], estimate[i + 1]);
    }
    for (const [x, y] of mission.beacons) take(x, y);
    return [west, south, east, north];
  }

  route(pen, at, colour, width) {
    const { start, end } = this.mission;
    const step = Math.max(1, (end - start) / STEPS);
    pen.beginPath();
    pen.strokeStyle = colour;
    pen.lineWidth = width;
    for (let t = start; t <= end; t += step) {
      const place = at(t);
      if (place) pen.lineTo(...this.to(place));
    }
    pen.stroke();
  }

  scale(pen, whole) {
    const bar = roundStep((this.width - 30) / this.zoom, whole ? 8 : 3);
    const from = whole ? this.width - 60 - bar * this.zoom : 9;
    const to = from + bar * this.zoom;
    pen.strokeStyle = "#dcecf3";
    pen.fillStyle = "#dcecf3";
    pen.lineWidth = 1.5;
    pen.beginPath();
    pen.moveTo(from, 9);
    pen.lineTo(from, 13);
    pen.lineTo(to, 13);
    pen.lineTo(to, 9);
    pen.stroke();
    pen.font = "11px system-ui, sans-serif";
    pen.fillText(`${bar} m`, from, 26);
    pen.textAlign = "right";
    pen.fillText("N ↑", this.width - 8, 18);
  }

  to({ x, y }) {
    return [this.x0 + this.zoom * x, this.y0 - this.zoom * y];
  }

  draw(t, followed) {
    const { pen, mission } = this;
    pen.clearRect(0, 0, this.width, this.height);
    pen.drawImage(this.still, 0, 0, this.width, this.height);
    for (let v = mission.count - 1; v >= 0; v--) {
      const leads = v === mission.leader;
      const [x, y] = this.to(mission.pose(v, t, point, turn));
      pen.beginPath();
      pen.arc(x, y, followed === v ? 4.5 : leads ? 3.6 : 2.6, 0, 2 * Math.PI);
      pen.fillStyle = css(leads ? mission.hues.leader : mission.truth ? mission.hues.truth : mission.hues.estimate);
      pen.fill();
      if (followed !== v) continue;
      pen.strokeStyle = "#fff";
      pen.lineWidth = 1.5;
      pen.stroke();
    }
  }

  /** Index of the vehicle nearest to a place on the map, within 14 pixels; undefined: none. */
  vehicleAt(x, y, t) {
    let nearest = 14;
    let found;
    for (let v = 0; v < this.mission.count; v++) {
      const [px, py] = this.to(this.mission.pose(v, t, point, turn));
      const away = Math.hypot(px - x, py - y);
      if (away < nearest) {
        nearest = away;
        found = v;
      }
    }
    return found;
  }
}
