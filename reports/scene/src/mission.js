// The mission at any time. World axes: x east, y north, z up [m]; times in [s], angles in [rad].
import { Quaternion, Vector3 } from "three";
import { unpack } from "./codec.js";

export const clamp = (value, low, high) => Math.min(Math.max(value, low), high);

const numbers = new Float64Array(8);
const turn = new Quaternion();
const arm = new Vector3();
const spot = new Vector3();
const other = new Vector3();

/** Index of the last of increasing times at or before `t`; -1 before the first. */
export function lastBefore(times, t) {
  let low = 0;
  let high = times.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (times[middle] <= t + 1e-6) low = middle + 1;
    else high = middle;
  }
  return low - 1;
}

/**
 * Vehicles, estimates, messages and events, as `reports/scene/mission.py` writes them.
 * Followers are those vehicles that estimate: follower f is vehicle `vehicleOf[f]`.
 */
export class Mission {
  constructor(meta, bytes) {
    Object.assign(this, meta);
    this.array = {};
    for (const [name, layout] of Object.entries(meta.arrays)) this.array[name] = unpack(bytes, layout);
    this.count = this.vehicles.length;
    this.leader = this.vehicles.findIndex((vehicle) => vehicle.role === "leader");
    this.vehicleOf = [];
    this.vehicles.forEach((vehicle, v) => {
      if (vehicle.role === "follower") this.vehicleOf.push(v);
    });
    this.followers = this.vehicleOf.length;
    this.followerOf = this.vehicles.map((_, v) => this.vehicleOf.indexOf(v));
    this.branches = this.vehicleOf.map(() => new Map());
    this.room = {};
    this.last = this.planned ?? this.end; // of the time line
    this.rows = 0;
    this.link(this.end, this.array);
    this.last = Math.max(this.last, this.end);
  }

  /** Bring what is derived from the arrays up to their present length; `added` are the latest parts of them. */
  link(end, added) {
    const first = this.rows;
    this.rows = this.array.position.length / (3 * this.count);
    this.end = Math.min(end, this.start + (this.rows - 1) / this.hz);
    this.messages = this.vehicleOf.map((_, f) => ({
      time: this.array[`time${f}`],
      kind: this.array[`kind${f}`],
      range: this.array[`range${f}`],
      source: this.array[`source${f}`],
    }));
    this.vehicleOf.forEach((_, f) => this.readBranches(this.branches[f], added[`branch${f}`]));
    if (this.truth) this.vehicleOf.forEach((_, f) => this.append(`error${f}`, this.errorsOf(f, first)));
    this.errors = this.truth ? this.vehicleOf.map((_, f) => this.array[`error${f}`]) : [];
  }

  /** Height of the floor at a place; beyond the known part, that of its edge [m]. */
  floorAt(x, y) {
    const bed = this.seabed;
    if (!bed) return this.floor;
    const last = bed.points - 1;
    const across = clamp(((x - bed.west) / (bed.east - bed.west)) * last, 0, last);
    const up = clamp(((y - bed.south) / (bed.north - bed.south)) * last, 0, last);
    const i = Math.min(Math.floor(across), last - 1);
    const j = Math.min(Math.floor(up), last - 1);
    const u = across - i;
    const v = up - j;
    const height = (row, column) => this.array.seabed[row * bed.points + column];
    const south = height(j, i) * (1 - u) + height(j, i + 1) * u;
    const north = height(j + 1, i) * (1 - u) + height(j + 1, i + 1) * u;
    return south * (1 - v) + north * v;
  }

  /** Take what a mission under way has added. */
  grow({ arrays, end, known, refused }, bytes) {
    const added = {};
    for (const [name, layout] of Object.entries(arrays)) {
      added[name] = unpack(bytes, layout);
      this.append(name, added[name]);
    }
    this.known = known;
    this.messagesRefused.push(...refused);
    this.link(end, added);
    this.last = Math.max(this.last, this.end);
  }

  append(name, values) {
    const before = this.array[name]?.length ?? 0;
    const length = before + values.length;
    if (!(this.room[name]?.length >= length)) {
      const room = new Float32Array(Math.max(2 * length, 1024));
      if (before) room.set(this.array[name]);
      this.room[name] = room;
    }
    this.room[name].set(values, before);
    this.array[name] = this.room[name].subarray(0, length);
  }

  /** Hypotheses by the index of the message after which they stood. */
  readBranches(of, table) {
    for (let i = 0; table && i < table.length; i += 7) {
      const message = table[i];
      if (!of.has(message)) of.set(message, []);
      const [weight, x, y, major, minor, angle] = table.subarray(i + 1, i + 7);
      of.get(message).push({ weight, x, y, major, minor, angle });
    }
  }

  /** Linear interpolation of `n` columns from `first` on of an array with `rate` rows a second. */
  mix(name, columns, rate, t, first, n, out = numbers) {
    const values = this.array[name];
    const last = values.length / columns - 1;
    const row = clamp((t - this.start) * rate, 0, last);
    const i = Math.min(Math.floor(row), Math.max(last - 1, 0));
    const w = last > 0 ? row - i : 0;
    const at = i * columns + first;
    const next = last > 0 ? columns : 0;
    for (let k = 0; k < n; k++) out[k] = values[at + k] + (values[at + k + next] - values[at + k]) * w;
    return out;
  }

  pose(v, t, position, quaternion = turn) {
    const p = this.mix("position", 3 * this.count, this.hz, t, 3 * v, 3);
    position.set(p[0], p[1], p[2]);
    const q = this.mix("quaternion", 4 * this.count, this.hz, t, 4 * v, 4);
    quaternion.set(q[1], q[2], q[3], q[0]).normalize();
    return position;
  }

  /** A place on a hull. */
  site(v, offset, t, out) {
    this.pose(v, t, out, turn);
    return offset ? out.add(arm.fromArray(offset).applyQuaternion(turn)) : out;
  }

  hydrophone(f, t, out) {
    const v = this.vehicleOf[f];
    return this.site(v, this.vehicles[v].hydrophone, t, out);
  }

  /** Estimated place of a hydrophone, drawn at its true depth, as the filter is planar; null: none yet. */
  estimate(f, t, out) {
    if (t < this.known[f]) return null;
    this.hydrophone(f, t, out);
    const p = this.mix("estimate", 2 * this.followers, this.hz, t, 2 * f, 2);
    return out.set(p[0], p[1], out.z);
  }

  /** Half axes and direction of the 1σ ellipse. */
  ellipse(f, t) {
    const major = this.mix("major", this.followers, this.slow_hz, t, f, 1)[0];
    const minor = this.mix("minor", this.followers, this.slow_hz, t, f, 1)[0];
    const [cosine, sine] = this.mix("axis", 2 * this.followers, this.slow_hz, t, 2 * f, 2);
    return { major, minor, angle: Math.atan2(sine, cosine) / 2 };
  }

  /** Hypotheses after the last message, moved as the estimate has moved since; none if there is one alone. */
  hypotheses(f, t) {
    const index = this.lastMessage(f, t);
    const branches = index < 0 ? undefined : this.branches[f].get(index);
    if (!branches) return [];
    const now = this.estimate(f, t, spot);
    if (!now) return [];
    const { x, y } = now;
    const then = this.estimate(f, this.messages[f].time[index], other);
    if (!then) return [];
    return branches.map((one) => ({ ...one, x: one.x + x - then.x, y: one.y + y - then.y }));
  }

  speed(v, t) {
    return this.mix("speed", this.count, this.slow_hz, t, v, 1)[0];
  }

  effector(v, column, t) {
    if (!this.array.effector) return 0;
    return this.mix("effector", this.columns * this.count, this.hz, t, v * this.columns + column, 1)[0];
  }

  /** Heading from north to the east, averaged over `over` seconds to both sides so that a camera can turn with it. */
  heading(v, t, over = 0) {
    let east = 0;
    let north = 0;
    const reach = over ? 4 : 0;
    for (let k = -reach; k <= reach; k++) {
      this.pose(v, clamp(t + (k * over) / 4, this.start, this.end), spot, turn);
      const ahead = arm.set(1, 0, 0).applyQuaternion(turn);
      east += ahead.x;
      north += ahead.y;
    }
    return Math.atan2(east, north);
  }

  pitch(v, t) {
    this.pose(v, t, spot, turn);
    return -Math.asin(clamp(2 * (turn.w * turn.y - turn.z * turn.x), -1, 1));
  }

  lastMessage(f, t) {
    return lastBefore(this.messages[f].time, t);
  }

  /** Position error of a follower at the rows of the data from `first` on; NaN before its first estimate. */
  errorsOf(f, first) {
    const errors = new Float32Array(this.rows - first);
    for (let i = 0; i < errors.length; i++) {
      const t = this.start + (first + i) / this.hz;
      const estimate = this.estimate(f, t, other);
      if (!estimate) {
        errors[i] = NaN;
        continue;
      }
      const { x, y } = estimate;
      const truth = this.hydrophone(f, t, other);
      errors[i] = Math.hypot(x - truth.x, y - truth.y);
    }
    return errors;
  }

  error(f, t) {
    const row = clamp(Math.round((t - this.start) * this.hz), 0, this.rows - 1);
    return this.truth ? this.errors[f][row] : NaN;
  }
}
