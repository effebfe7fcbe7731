// Words beside points of the scene: the nearest first, each where it covers neither another nor a panel.
import { Vector3 } from "three";
import { css } from "./view.js";

const ROWS = 16; // places of a label: rows above and below its point, on either side
const MOST = 24; // labels at a time
const point = new Vector3();

export class Labels {
  /** `covered` are elements of the page that labels must leave free. */
  constructor(box, covered) {
    this.box = box;
    this.covered = covered;
    this.items = new Map();
    this.pen = document.createElement("canvas").getContext("2d");
  }

  item(key) {
    let item = this.items.get(key);
    if (!item) {
      item = { span: document.createElement("span"), line: document.createElement("i"), slot: 0, words: null };
      this.box.append(item.line, item.span);
      this.items.set(key, item);
    }
    return item;
  }

  draw(view) {
    const { width, height } = view;
    this.size = width < 900 ? 11.5 : 12.5;
    this.pen.font = `600 ${this.size}px ${getComputedStyle(this.box).fontFamily}`;
    const taken = this.covered.filter((element) => element.offsetWidth).map((element) => [
      element.offsetLeft,
      element.offsetTop,
      element.offsetLeft + element.offsetWidth,
      element.offsetTop + element.offsetHeight,
    ]);
    const shown = this.project(view);
    for (const item of this.items.values()) item.seen = false;
    for (const { x, y } of shown) taken.push([x - 7, y - 7, x + 7, y + 7]);
    taken.push(...this.hulls(view));
    for (const label of shown.slice(0, MOST)) this.set(label, view, taken);
    for (const { span, line, seen } of this.items.values()) {
      span.style.display = seen ? "" : "none";
      line.style.display = seen ? "" : "none";
    }
  }

  /** Labels with places on the screen: the followed vehicle's first, then the leader's, then the nearest. */
  project(view) {
    const { width, height, camera, follow, mission } = view;
    const rank = (label) => (label.v === follow ? 0 : label.v === mission.leader ? 1 : 2);
    const placed = view.labels.map((label) => {
      point.copy(label.at).project(camera);
      const away = label.at.distanceTo(camera.position);
      return { ...label, x: ((point.x + 1) / 2) * width, y: ((1 - point.y) / 2) * height, deep: point.z, away };
    });
    return placed
      .filter(({ x, y, deep }) => deep < 1 && x > 4 && x < width - 4 && y > 4 && y < height - 4)
      .sort((label, other) => rank(label) - rank(other) || label.away - other.away);
  }

  /** Boxes about the hulls on the screen. */
  hulls(view) {
    const { width, height, camera } = view;
    const half = 0.5 * view.fleets[0].length * view.size;
    const boxes = [];
    for (const { position, quaternion } of view.poses) {
      const ends = [-half, half].map((x) => {
        point.set(x, 0, 0).applyQuaternion(quaternion).add(position).project(camera);
        return { x: ((point.x + 1) / 2) * width, y: ((1 - point.y) / 2) * height, deep: point.z };
      });
      if (ends.some((end) => end.deep >= 1)) continue;
      const xs = ends.map((end) => end.x);
      const ys = ends.map((end) => end.y);
      boxes.push([Math.min(...xs), Math.min(...ys) - 4, Math.max(...xs), Math.max(...ys) + 4]);
    }
    return boxes;
  }

  words(label, view) {
    const { mission, follow, poses } = view;
    if (label.v !== mission.leader || follow < 0 || follow === mission.leader) return label.words;
    const away = poses[mission.leader].position.distanceTo(poses[follow].position);
    return `${label.words}, ${away.toFixed(0)} m away`;
  }

  /** Put a label into the first free place; its last place is tried first, or labels would jump. */
  set(label, view, taken) {
    const item = this.item(label.key);
    const words = this.words(label, view);
    if (item.words !== words) {
      item.words = words;
      item.span.textContent = words;
      item.span.style.color = css(label.colour);
      item.line.style.background = css(label.colour);
    }
    const wide = this.pen.measureText(words).width + 10;
    const high = 1.3 * this.size + 2;
    for (const slot of [item.slot, ...Array(ROWS).keys()]) {
      const row = slot >> 2;
      const above = ((slot >> 1) & 1) !== (label.below ? 1 : 0);
      const right = (slot & 1) === 0;
      const left = label.x + (right ? 12 + 8 * row : -12 - 8 * row - wide);
      const top = label.y + (above ? -20 - 20 * row - high : 20 + 20 * row);
      const inside = left >= 2 && top >= 2 && left + wide <= view.width - 2 && top + high <= view.height - 2;
      const free = taken.every(([l, t, r, b]) => left >= r + 2 || left + wide <= l - 2 || top >= b + 1 || top + high <= t - 1);
      if (!inside || !free) continue;
      taken.push([left, top, left + wide, top + high]);
      item.slot = slot;
      item.seen = true;
      item.span.style.transform = `translate(${left.toFixed(1)}px,${top.toFixed(1)}px)`;
      const x = right ? left : left + wide;
      const y = above ? top + high : top;
      const angle = Math.atan2(label.y - y, label.x - x);
      item.line.style.width = `${Math.hypot(label.x - x, label.y - y).toFixed(1)}px`;
      item.line.style.transform = `translate(${x.toFixed(1)}px,${y.toFixed(1)}px) rotate(${angle.toFixed(3)}rad)`;
      return;
    }
  }
}
