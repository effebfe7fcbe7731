// Events below the scene's slider: turns, losses, rejected messages, mirror locks and warnings.
import { fitted, theme } from "./drawing.js";

/** Colour, as a variable of the page's style, and words of each kind of event. */
export const EVENTS = {
  turn: { colour: "ink", words: "turn" },
  gate: { colour: "failure", words: "message rejected" },
  loss: { colour: "warning", words: "message lost" },
  mirror: { colour: "estimate", words: "mirror lock" },
  note: { colour: "warning", words: "warning" },
};
const EDGE = 9; // half of the slider's knob [px]
const BIN = 3; // width of a bin of many followers' messages [px]

export class Timeline {
  constructor(mission, canvas) {
    this.mission = mission;
    this.canvas = canvas;
  }

  /** Ticks of a follower, or of all for -1. */
  draw(filmed) {
    const { mission } = this;
    const { pen, width, height } = fitted(this.canvas);
    const x = (t) => EDGE + ((t - mission.start) / (mission.last - mission.start)) * (width - 2 * EDGE);
    pen.clearRect(0, 0, width, height);
    pen.fillStyle = theme("grid");
    pen.fillRect(EDGE, 19, width - 2 * EDGE, 4);
    pen.globalAlpha = 0.3;
    pen.fillStyle = theme("estimate");
    for (const [f, begin, end] of mission.locks) {
      if (filmed < 0 || f === filmed) pen.fillRect(x(begin), 14, Math.max(1.5, x(end) - x(begin)), 14);
    }
    this.drawMessages(pen, x, width, filmed);
    pen.globalAlpha = 1;
    for (const [t, kind] of mission.events) {
      if (kind === "mirror") continue;
      pen.fillStyle = theme(EVENTS[kind].colour);
      pen.fillRect(x(t) - 1, 3, 2, 12);
    }
  }

  /** A tick for each message that was lost or rejected; of many followers the share of those that had any. */
  drawMessages(pen, x, width, filmed) {
    const { mission } = this;
    const chosen = mission.messagesRefused.filter(([, , f]) => filmed < 0 || f === filmed);
    if (filmed >= 0 || mission.followers === 1) {
      pen.globalAlpha = 0.75;
      for (const [t, kind] of chosen) {
        pen.fillStyle = theme(EVENTS[kind].colour);
        pen.fillRect(x(t) - 0.5, 30, 1, 7);
      }
      return;
    }
    for (const kind of ["loss", "gate"]) {
      const bins = new Map();
      for (const [t, of] of chosen) if (of === kind) bins.set(Math.floor(x(t) / BIN), (bins.get(Math.floor(x(t) / BIN)) ?? 0) + 1);
      const most = Math.max(...bins.values(), 1);
      pen.globalAlpha = 0.75;
      pen.fillStyle = theme(EVENTS[kind].colour);
      for (const [bin, many] of bins) {
        const high = 2 + (7 * many) / most;
        pen.fillRect(bin * BIN, 39 - high, BIN, high);
      }
    }
  }
}
