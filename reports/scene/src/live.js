// Follows a mission that is under way: what happens comes as server-sent events of the page's own host.
// Messages are those of reports/scene/stream.py and laisn_sim/live.py.
import { inflate } from "./codec.js";
import { clamp } from "./mission.js";

const BEHIND_S = 0.4; // how far the picture is behind the mission, so that it moves evenly, in the viewer's seconds
const LEAST_REDRAW_MS = 1000; // between drawings of trails, map and time line
const REDRAW_SHARE = 10; // at least so many times as long as they take

export class Live {
  constructor(mission, replay) {
    this.mission = mission;
    this.replay = replay;
    this.speed = replay.state.speed; // Infinity: as fast as possible
    this.paused = false;
    this.following = true; // the present, not a time that was chosen
    this.over = false;
    this.redrawn = 0;
    this.redrawMs = 0;
    this.queue = Promise.resolve();
    this.source = new EventSource("events");
    this.source.onmessage = (event) => {
      this.queue = this.queue.then(() => this.take(JSON.parse(event.data)));
    };
    // after what came before
    this.source.onerror = () => {
      this.source.close();
      this.queue = this.queue.then(() => this.stop("the connection to the mission is lost"));
    };
  }

  async take(message) {
    if (message.anew) location.reload();
    else if (message.over !== undefined) this.end(message);
    else if (message.arrays) await this.grow(message);
    else this.set(message);
  }

  set({ paused, speed }) {
    this.paused = paused;
    this.speed = speed || Infinity;
    if (paused && this.following) this.replay.state.time = this.mission.end;
    this.replay.controlled();
  }

  async grow(part) {
    this.mission.grow(part, await inflate(part.data));
    const began = performance.now();
    if (began - this.redrawn > Math.max(LEAST_REDRAW_MS, REDRAW_SHARE * this.redrawMs)) {
      this.replay.grown();
      this.redrawn = performance.now();
      this.redrawMs = this.redrawn - began;
    }
    this.replay.ask();
  }

  end({ over, events, locks }) {
    Object.assign(this.mission, { events, locks });
    this.stop(over);
  }

  stop(words) {
    if (this.over) return;
    this.over = true;
    this.source.close();
    this.replay.ended(words);
  }

  /** The time that is shown `passed` seconds later. */
  advance(time, passed) {
    const { end } = this.mission;
    if (!this.following) return Math.min(end, time + passed * Math.min(this.speed, 100));
    if (this.speed === Infinity) return time + (end - time) * Math.min(1, 4 * passed);
    const behind = (end - time) / this.speed;
    if (behind > 3) return end - BEHIND_S * this.speed;
    return Math.min(end, time + passed * this.speed * clamp(1 + 2 * (behind - BEHIND_S), 0.3, 3));
  }

  /** Ask the mission to pause, to go on, or for another speed. */
  ask(wanted) {
    return fetch("control", { method: "POST", body: JSON.stringify(wanted) })
      .catch(() => this.stop("the connection to the mission is lost"));
  }
}
