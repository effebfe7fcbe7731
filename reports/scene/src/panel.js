// The numbers of the present, over the upper left of the scene.
import { clock } from "./drawing.js";
import { REFUSED, css } from "./view.js";

const DASH = "–";
const TRANSMITTERS = ["rear", "front", "middle"];
const fixed = (value, digits, unit = "") => (Number.isFinite(value) ? value.toFixed(digits) + unit : DASH);
const signed = (value) => (value < 0 ? "−" : "+") + Math.abs(value).toFixed(1);
const degrees = (radians) => ((((radians * 180) / Math.PI) % 360) + 360) % 360;
const escape = (text) => text.replace(/[&<>"]/g, (letter) => `&#${letter.charCodeAt(0)};`);

function row(head, cells, style = "", span = 1) {
  const data = cells.map((cell) => `<td colspan="${span}">${cell}</td>`).join("");
  return `<tr class="${style}"><th>${head}</th>${data}</tr>`;
}

export class Panel {
  constructor(mission, table, time) {
    this.mission = mission;
    this.table = table;
    this.time = time;
    this.html = "";
  }

  /** Write the numbers at a time; `follower` is the followed one's index, -1 for none. */
  draw(t, follower) {
    const { mission } = this;
    const vehicles = [mission.leader, follower >= 0 ? mission.vehicleOf[follower] : -1].filter((v) => v >= 0);
    let html = this.motion(vehicles, t);
    if (follower >= 0) html += this.estimate(follower, vehicles.length, t);
    else if (mission.truth && mission.followers) html += this.errors(t);
    if (html !== this.html) {
      this.table.innerHTML = html;
      this.html = html;
    }
    this.time.textContent = clock(t);
  }

  motion(vehicles, t) {
    const { mission } = this;
    const position = mission.scratch;
    const cells = (of) => vehicles.map(of);
    const heads = cells((v) => {
      const hue = v === mission.leader ? mission.hues.leader : mission.truth ? mission.hues.truth : mission.hues.estimate;
      return `<b style="color:${css(hue)}">${escape(mission.vehicles[v].name)}</b>`;
    });
    return [
      row("", heads),
      row("depth [m]", cells((v) => (-mission.pose(v, t, position).z).toFixed(1))),
      row("heading [°]", cells((v) => String(Math.round(degrees(mission.heading(v, t))) % 360).padStart(3, "0"))),
      mission.truth ? row("pitch [°]", cells((v) => signed((mission.pitch(v, t) * 180) / Math.PI)), "more") : "",
      row("speed [m/s]", cells((v) => mission.speed(v, t).toFixed(2)), "more"),
    ].join("");
  }

  estimate(f, columns, t) {
    const { mission } = this;
    const m = mission.lastMessage(f, t);
    const { kind, range } = mission.messages[f];
    const refused = m >= 0 && mission.refusedKinds.includes(kind[m]);
    const ranges = TRANSMITTERS.slice(0, mission.used).map((_, i) => {
      const value = m < 0 ? 0 : range[3 * m + i];
      return value > 0 ? value.toFixed(2) : DASH;
    });
    const words = m < 0 || kind[m] < 0 ? DASH : mission.words[kind[m]];
    const fix = refused ? `<b style="color:${css(REFUSED)}">${words}</b>` : words;
    const two = 2 * mission.ellipse(f, t).major;
    const sigma = two < 0.005 ? "below 1 cm" : fixed(two, 2, " m");
    const ready = t >= mission.known[f];
    return [
      row("ranges [m]", [ranges.join(" ")], "gap more", columns),
      row("fix", [fix], "more", columns),
      mission.truth ? row("position error", [fixed(mission.error(f, t), 2, " m")], "sum gap", columns) : "",
      row("filter's 2σ", [ready ? sigma : DASH], mission.truth ? "" : "sum gap", columns),
    ].join("");
  }

  errors(t) {
    const { mission } = this;
    const errors = mission.errors.map((_, f) => mission.error(f, t));
    const finite = errors.filter(Number.isFinite);
    if (!finite.length) return row("position error", [DASH], "sum gap");
    const mean = finite.reduce((sum, error) => sum + error, 0) / finite.length;
    const worst = errors.indexOf(Math.max(...finite));
    return [
      row("mean error", [fixed(mean, 2, " m")], "sum gap"),
      row("largest", [fixed(errors[worst], 2, " m")]),
      row("", [escape(mission.vehicles[mission.vehicleOf[worst]].name)]),
    ].join("");
  }
}
