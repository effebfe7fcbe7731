// Replays a mission in 3D: reads the data of the page, and links the scene with slider, map, numbers and figures.
// Figures of the page (`reports/templates/figures.js`) share its time by two events of the document:
// "mission:time" tells them the time of the scene, "mission:seek" asks the scene for another.
import { Vector3 } from "three";
import { CAMERAS } from "./cameras.js";
import { inflate } from "./codec.js";
import { clock, roundStep } from "./drawing.js";
import { Labels } from "./labels.js";
import { Live } from "./live.js";
import { Mission, clamp } from "./mission.js";
import { Panel } from "./panel.js";
import { RouteMap } from "./routes.js";
import { EVENTS, Timeline } from "./timeline.js";
import { REFUSED, USED, View, calm, css } from "./view.js";

const SPEEDS = [0.5, 1, 2, 5, 10, 20, 50, 100];
const SLOW_MS = 75; // frames that take longer have fewer pixels
const FAST_MS = 18; // if they take less, more of the sea is drawn
const TOLD_MS = { software: 300, hardware: 60 }; // how often numbers, map and figures follow while playing
const MOST_EVENTS = 200;

const element = (name) => document.getElementById(`scene-${name}`);

class Replay {
  constructor(mission, link) {
    this.mission = mission;
    this.state = { time: mission.start, speed: 10, playing: false, sea: 0, frames: 0 };
    this.visible = true;
    this.asked = false;
    this.before = 0;
    this.told = 0;
    this.load = { mean: 0, count: 0, raised: false };
    const asked = link.get("t");
    this.state.time = clamp(asked === null ? mission.opening : Number(asked), mission.start, mission.end);
    this.view = this.makeView(link);
    const covered = ["panel", "map", "foot"].map(element);
    this.labels = new Labels(element("labels"), covered);
    this.map = new RouteMap(mission, element("map"));
    this.timeline = new Timeline(mission, element("ticks"));
    this.panel = new Panel(mission, element("numbers"), element("clock"));
    this.wire();
    this.live = mission.planned === undefined ? null : new Live(mission, this);
    if (this.live) this.wireLive();
    if (this.view) this.openCamera(link);
    this.redraw();
  }

  /** The 3D view; without WebGL none, and the map takes its place. */
  makeView(link) {
    try {
      const quality = link.get("q");
      const view = new View(this.mission, element("view"), quality === null ? undefined : Number(quality));
      view.ask = () => this.ask();
      view.time = this.state.time;
      const followed = link.get("follow");
      if (followed !== null) view.cameras.follow = clamp(Number(followed), -1, this.mission.count - 1);
      view.drawEstimates();
      view.resize(true, performance.now());
      view.cameras.start(this.state.time);
      return view;
    } catch (error) {
      element("stage").classList.add("flat");
      element("fallback").hidden = false;
      element("fallback").textContent = `This browser shows no 3D graphics (${error.message}): the map shows the mission instead.`;
      return null;
    }
  }

  openCamera(link) {
    const { view } = this;
    const usual = view.crowded && view.follow < 0 ? "all" : "chase";
    this.chooseCamera(Object.hasOwn(CAMERAS, link.get("camera")) ? link.get("camera") : usual, true);
    element("follow").value = view.follow;
    const at = link.get("at")?.split(",").map(Number);
    if (at?.length === 3 && at.every(Number.isFinite)) {
      view.camera.position.copy(view.cameras.controls.target).add(new Vector3(...at));
    }
    view.canvas.addEventListener("webglcontextlost", (event) => {
      event.preventDefault();
      this.play(false);
    });
    view.canvas.addEventListener("webglcontextrestored", () => this.ask());
    // software renderers compile for each size of the picture: here, or play would begin with a jerk
    if (view.software) view.draw(performance.now(), { turned: 0, speed: 1, sea: 0, busy: true });
  }

  get filmed() {
    if (this.view) return this.view.filmed;
    return this.mission.followers === 1 ? 0 : -1;
  }

  // ------------------------------------------------------------------------------------------------ time

  setTime(t) {
    if (!Number.isFinite(t)) return;
    this.state.time = clamp(t, this.mission.start, this.mission.end);
    if (this.live) this.live.following = this.state.time >= this.mission.end;
    this.ask();
  }

  get underWay() {
    return Boolean(this.live) && !this.live.over;
  }

  play(on) {
    const { state, mission } = this;
    if (this.underWay) {
      this.live.ask({ paused: !on });
      return;
    }
    state.playing = on;
    if (on && state.time >= mission.end - 1e-3) state.time = mission.start;
    this.showPlaying();
    this.ask();
  }

  showPlaying() {
    const { playing } = this.state;
    element("replay").classList.toggle("playing", playing);
    element("play").setAttribute("aria-label", playing ? "Pause" : "Play");
    if (!playing) this.say();
  }

  /** For screen readers, when the time stands still. */
  say() {
    const { mission, state } = this;
    const errors = mission.errors.map((_, f) => (
      `${mission.vehicles[mission.vehicleOf[f]].name} ${mission.error(f, state.time).toFixed(2)} m`
    ));
    element("said").textContent = `${clock(state.time)}${errors.length ? `; position error of ${errors.join(", ")}` : ""}`;
  }

  ask() {
    if (this.asked) return;
    this.asked = true;
    requestAnimationFrame((now) => this.frame(now));
  }

  /** Fewer pixels, and then less of the sea, where frames take long; more again if there is time to spare. */
  adapt(ms) {
    const { view, load } = this;
    if (!view || view.fixed) return;
    load.mean = load.count ? load.mean + 0.1 * (ms - load.mean) : ms;
    load.count++;
    if (load.count < 15) return;
    if (load.mean > SLOW_MS && (view.quality > 0 || view.coarse > 0.7)) {
      if (view.quality > 0) view.quality--;
      else view.coarse = 0.7;
      load.count = 0;
    } else if (load.mean < FAST_MS && load.count > 240 && view.quality < 2 && !view.software && !load.raised) {
      view.quality++;
      load.raised = true;
      load.count = 0;
    }
  }

  frame(now) {
    this.asked = false;
    const { state, view, mission } = this;
    const passed = Math.min((now - this.before) / 1000, 0.25);
    if (state.playing) {
      this.adapt(now - this.before);
      state.time = this.underWay ? this.live.advance(state.time, passed) : state.time + passed * state.speed;
      if (state.time >= mission.end && !this.underWay) {
        state.time = mission.end;
        this.play(false);
      }
    }
    this.before = now;
    const ambient = Boolean(view) && !view.software && !calm && this.visible;
    if (state.playing || ambient) state.sea += passed;
    let again = state.playing || ambient;
    if (view) {
      view.time = state.time;
      view.draw(now, { turned: state.playing ? passed : 0, speed: state.speed, sea: state.sea, busy: state.playing });
      this.labels.draw(view);
      this.drawFoot();
      again ||= view.cameras.busy || !view.sharp;
    }
    if (!state.frames++) document.documentElement.dataset.first = Math.round(performance.now());
    // numbers that change faster cannot be read, and redrawing the page costs a software renderer as much as the scene
    if (!state.playing || now - this.told > TOLD_MS[view?.software ? "software" : "hardware"]) {
      this.told = now;
      this.tell();
    }
    if (again && this.visible) this.ask();
  }

  tell() {
    const { state, mission } = this;
    this.panel.draw(state.time, this.filmed);
    this.map.draw(state.time, this.view ? this.view.follow : -1);
    const slider = element("time");
    slider.value = state.time;
    slider.setAttribute("aria-valuetext", `${clock(state.time)} of ${clock(mission.end)}`);
    if (this.toldTime === state.time) return;
    this.toldTime = state.time;
    document.dispatchEvent(new CustomEvent("mission:time", { detail: state.time }));
  }

  drawFoot() {
    const { metres, camera, cameras, size, follow } = this.view;
    const length = roundStep(150 * metres, 1.6);
    const [bar, words] = element("scale").children;
    bar.style.width = `${(length / metres).toFixed(1)}px`;
    words.textContent = `${Number(length.toPrecision(2))} m at ${follow < 0 ? "the middle" : "the vehicle"}`;
    const { x, y } = cameras.controls.target;
    const turn = Math.atan2(x - camera.position.x, y - camera.position.y);
    element("needle").setAttribute("transform", `rotate(${((-turn * 180) / Math.PI).toFixed(1)})`);
    element("size").textContent = size > 1 ? `hulls drawn ${size}× as large` : "";
  }

  // ------------------------------------------------------------------------------------------------ live

  wireLive() {
    element("speed").append(new Option("fastest", 0));
    element("speed").onchange = (event) => this.live.ask({ speed: Number(event.target.value) });
    element("head").onclick = () => this.setTime(this.mission.end);
    element("time").max = this.mission.last;
    element("length").textContent = `of ${clock(this.mission.last)}`;
    this.state.playing = true;
    this.showPlaying();
  }

  /** The mission paused, goes on, or has another speed. */
  controlled() {
    const { live, state } = this;
    state.playing = !live.paused;
    state.speed = Math.min(live.speed, SPEEDS.at(-1));
    const value = live.speed === Infinity ? 0 : live.speed;
    const select = element("speed");
    if (![...select.options].some((option) => Number(option.value) === value)) select.append(new Option(`${value}×`, value));
    select.value = value;
    this.showPlaying();
    this.ask();
  }

  grown() {
    if (this.view) this.view.grow();
    this.redraw();
  }

  /** The mission is over, or out of reach: the page replays what it has. */
  ended(words) {
    element("head").textContent = "Over";
    element("head").title = words;
    element("said").textContent = words;
    element("head").disabled = true;
    const slider = element("time");
    this.mission.last = this.mission.end;
    slider.max = this.mission.end;
    element("length").textContent = `of ${clock(this.mission.end)}`;
    element("speed").querySelector('[value="0"]').remove();
    element("speed").onchange = (event) => {
      this.state.speed = Number(event.target.value);
    };
    element("speed").value = this.state.speed;
    if (this.live.following) this.state.time = this.mission.end;
    this.state.playing = false;
    this.showPlaying();
    this.listEvents();
    this.legend();
    this.grown();
  }

  // ------------------------------------------------------------------------------------------------ controls

  chooseCamera(name, now = false) {
    element("camera").value = name;
    if (name === "all" && this.view.follow >= 0 && this.mission.followers > 1) this.follow(-1);
    this.view.cameras.use(name, now);
  }

  follow(vehicle) {
    element("follow").value = vehicle;
    this.view.look(vehicle);
    this.timeline.draw(this.filmed);
    this.ask();
  }

  /** The hash of a link to this camera and time. */
  link() {
    const { camera, cameras, follow } = this.view;
    const offset = camera.position.clone().sub(cameras.controls.target).toArray();
    const at = offset.map((value) => value.toFixed(2)).join(",");
    return `#t=${this.state.time.toFixed(1)}&follow=${follow}&camera=${cameras.name}&at=${at}`;
  }

  copy() {
    history.replaceState(null, "", this.link());
    this.copyText("copy", location.href, "In the address bar");
  }

  /** Options of `laisn render` for this camera and time: offsets from a vehicle, or places in the world [m]. */
  options() {
    const { camera, cameras, follow } = this.view;
    const places = (vector) => vector.toArray().map((value) => value.toFixed(2)).join(",");
    const target = cameras.controls.target;
    const view = follow < 0
      ? `${places(camera.position)},${places(target)}`
      : `${this.mission.vehicles[follow].name}:${places(camera.position.clone().sub(target))}`;
    return `--view="${view}" --still ${this.state.time.toFixed(1)}`;
  }

  copyCamera() {
    const text = this.options();
    this.copyText("camera-options", text, text);
  }

  async copyText(name, text, otherwise) {
    const button = element(name);
    const words = (this.buttonWords ??= {})[name] ??= button.textContent;
    try {
      await navigator.clipboard.writeText(text);
      button.textContent = "Copied";
    } catch {
      button.textContent = otherwise;
    }
    setTimeout(() => {
      button.textContent = words;
    }, 4000);
  }

  wire() {
    const { mission, state } = this;
    const fill = (select, pairs) => select.replaceChildren(...pairs.map(([value, words]) => new Option(words, value)));
    fill(element("speed"), SPEEDS.map((speed) => [speed, `${speed}×`]));
    element("speed").value = state.speed;
    element("speed").onchange = (event) => {
      state.speed = Number(event.target.value);
    };
    const slider = element("time");
    slider.min = mission.start;
    slider.max = mission.end;
    slider.oninput = () => this.setTime(Number(slider.value));
    slider.onchange = () => this.say();
    element("play").onclick = () => this.play(!state.playing);
    element("length").textContent = `of ${clock(mission.end)}`;
    if (this.view) this.wireView(fill);
    else for (const name of ["camera", "follow", "true-size", "copy", "camera-options"]) (element(name).closest("label") ?? element(name)).hidden = true;
    this.listEvents();
    this.legend();
    document.addEventListener("mission:seek", (event) => this.setTime(event.detail));
    addEventListener("keydown", (event) => this.key(event));
    addEventListener("beforeprint", () => this.print());
    addEventListener("afterprint", () => element("print").replaceChildren());
    new ResizeObserver(() => this.redraw()).observe(element("stage"));
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.redraw());
    new IntersectionObserver(([entry]) => {
      this.visible = entry.isIntersecting;
      if (this.visible) this.ask();
    }).observe(element("replay"));
  }

  wireView(fill) {
    const { mission, view } = this;
    fill(element("camera"), Object.entries(CAMERAS));
    fill(element("follow"), [[-1, "all vehicles"], ...mission.vehicles.map((vehicle, v) => [v, vehicle.name])]);
    element("camera").onchange = (event) => this.chooseCamera(event.target.value);
    element("follow").onchange = (event) => this.follow(Number(event.target.value));
    element("true-size").onchange = (event) => {
      view.trueSize = event.target.checked;
      this.ask();
    };
    element("copy").onclick = () => this.copy();
    element("camera-options").onclick = () => this.copyCamera();
    element("map").onclick = (event) => {
      const vehicle = this.map.vehicleAt(event.offsetX, event.offsetY, this.state.time);
      if (vehicle !== undefined) this.follow(vehicle);
    };
  }

  listEvents() {
    const events = this.mission.events.slice(0, MOST_EVENTS);
    const list = element("events");
    list.replaceChildren(...events.map(([t, , words]) => {
      const item = document.createElement("li");
      const button = document.createElement("button");
      button.type = "button";
      button.textContent = clock(t);
      button.onclick = () => this.setTime(t);
      item.append(button, ` ${words}`);
      return item;
    }));
    list.closest("details").hidden = !events.length;
  }

  legend() {
    const { mission } = this;
    const swatches = [];
    const swatch = (style, words) => swatches.push(`<span><b class="${style.kind}" style="${style.css}"></b>${words}</span>`);
    const line = (colour) => ({ kind: "key", css: `background:${colour}` });
    if (mission.leader >= 0) swatch(line("var(--leader)"), "leader");
    if (mission.beacons.length) swatch(line("var(--leader)"), "transmitters");
    if (mission.truth) swatch(line("var(--follower)"), mission.followers > 1 ? "followers" : "follower");
    swatch(line("var(--estimate)"), "estimate, 2σ ellipse");
    swatch(line(css(USED.map((v) => 0.75 * v))), "range used");
    swatch(line(css(REFUSED)), "range rejected, dashed: lost");
    if (mission.vehicles.some((vehicle) => vehicle.station !== null)) {
      swatch({ kind: "dot ring", css: `border-color:${css(mission.hues.station.map((v) => 0.7 * v))}` }, "station");
    }
    const kinds = new Set([...mission.events, ...mission.messagesRefused].map(([, kind]) => kind));
    if (mission.locks.length) kinds.add("mirror");
    for (const [kind, { colour, words }] of Object.entries(EVENTS)) {
      if (kinds.has(kind)) swatch({ kind: "tick", css: `background:var(--${colour})` }, words);
    }
    element("legend").innerHTML = swatches.join("");
  }

  /** The next event before or after now. */
  eventBeside(sign) {
    const times = this.mission.events.map(([t]) => t).filter((t) => sign * (t - this.state.time) > 0.05);
    return times.length ? times.reduce((near, t) => (sign * t < sign * near ? t : near)) : undefined;
  }

  changeSpeed(by) {
    const index = clamp(SPEEDS.indexOf(this.state.speed) + by, 0, SPEEDS.length - 1);
    if (this.underWay) {
      this.live.ask({ speed: SPEEDS[index] });
      return;
    }
    this.state.speed = SPEEDS[index];
    element("speed").value = this.state.speed;
  }

  key(event) {
    const typing = event.target.closest?.("select, input:not(#scene-time), textarea, summary");
    if (event.ctrlKey || event.metaKey || event.altKey || typing || !this.visible) return;
    const { state, mission, view } = this;
    const camera = { 1: "chase", 2: "side", 3: "top", 4: "all", 5: "free" }[event.key];
    const step = event.shiftKey ? 60 : 5;
    const acts = {
      " ": () => this.play(!state.playing),
      ArrowLeft: () => this.setTime(state.time - step),
      ArrowRight: () => this.setTime(state.time + step),
      ArrowUp: () => this.changeSpeed(1),
      ArrowDown: () => this.changeSpeed(-1),
      Home: () => this.setTime(mission.start),
      End: () => this.setTime(mission.end),
      f: () => view && this.follow(view.follow + 1 < mission.count ? view.follow + 1 : -1),
      ",": () => this.setTime(this.eventBeside(-1)),
      ".": () => this.setTime(this.eventBeside(1)),
    };
    // elsewhere on the page arrows and space scroll, and buttons keep their space
    const scrolls = / |Arrow|Home|End/.test(event.key);
    if (scrolls && (!element("replay").contains(event.target) || (event.key === " " && event.target.closest("button")))) return;
    if (camera && view) this.chooseCamera(camera);
    else if (acts[event.key]) acts[event.key]();
    else return;
    event.preventDefault();
  }

  redraw() {
    this.map.layout(!this.view);
    this.timeline.draw(this.filmed);
    this.toldTime = undefined;
    this.ask();
  }

  /** A picture for paper: the buffer of the canvas is gone when a page is printed. */
  print() {
    if (!this.view) return;
    this.view.draw(performance.now(), { turned: 0, speed: 1, sea: this.state.sea, busy: false });
    const picture = new Image();
    picture.src = this.view.canvas.toDataURL();
    element("print").replaceChildren(picture);
  }
}

async function start() {
  const meta = JSON.parse(document.getElementById("scene-meta").textContent);
  const mission = new Mission(meta, await inflate(document.getElementById("scene-data").textContent));
  mission.scratch = new Vector3();
  const replay = new Replay(mission, new URLSearchParams(location.hash.slice(1)));
  window.replay = replay; // for tests and the curious
  document.documentElement.dataset.scene = "ready";
}

start();
