// Figures: SVG from what `Panel.figure` describes, a small part of Plotly's language. Colours are variables of the page,
// so that they follow its theme. A pointer shows values, a drag zooms, a double click shows all again. Figures with one
// data-link show the same time under the pointer; where the page has a scene in 3D, a click sets its time, and its time
// stands in all figures over time.
const NS = "http://www.w3.org/2000/svg";
const TICK = 4; // length of ticks [px]
const LETTER = 6.4; // mean width of a letter [px]
const DASHES = { dash: "7 5", dot: "1.5 3.5" };
const PLAYS = document.getElementById("scene-replay") !== null;

function svg(name, attributes = {}, parent = undefined) {
  const node = document.createElementNS(NS, name);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  parent?.append(node);
  return node;
}

/** Text with <i> and <sub> of the page's symbols as tspans. */
function rich(node, html) {
  let italic = false;
  let lowered = 0;
  let bold = false;
  for (const piece of String(html).split(/(<\/?(?:i|sub|b|br)>)/)) {
    if (/^<\/?i>$/.test(piece)) italic = piece === "<i>";
    else if (/^<\/?b>$/.test(piece)) bold = piece === "<b>";
    else if (piece === "<sub>") lowered = 1;
    else if (piece === "</sub>") lowered = -1;
    else if (piece && piece !== "<br>") {
      const span = svg("tspan", {}, node);
      span.textContent = plain(piece);
      if (italic) span.setAttribute("font-style", "italic");
      if (bold) span.setAttribute("font-weight", "600");
      if (lowered) span.setAttribute("dy", `${0.25 * lowered}em`);
      if (lowered > 0) span.setAttribute("font-size", "80%");
      if (lowered < 0) lowered = 0;
    }
  }
  return node;
}

/** Text without tags and entities. */
function plain(html) {
  const holder = document.createElement("template");
  holder.innerHTML = html;
  return holder.content.textContent;
}

const finite = (values) => values.filter((value) => value !== null && Number.isFinite(value));
const round = (value) => Math.round(value * 10) / 10;
const short = (value) => (value === 0 ? "0" : Number(value.toPrecision(4)).toString().replace("-", "−"));

/** Round numbers over an interval, about `most` of them. */
function roundTicks(low, high, most) {
  const raw = (high - low) / Math.max(most, 1);
  const unit = 10 ** Math.floor(Math.log10(raw));
  const step = unit * [1, 2, 5, 10].find((factor) => factor * unit >= raw * 0.999);
  const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  const ticks = [];
  for (let i = Math.ceil(low / step - 1e-9); i * step <= high + 1e-9 * step; i++) {
    const value = i * step;
    ticks.push([value, (Math.abs(value) < step / 2 ? 0 : value).toFixed(digits).replace("-", "−")]);
  }
  return ticks;
}

/** An axis: what it shows, and where values stand on it. */
class Axis {
  constructor(description, values, margin) {
    this.log = description.type === "log";
    this.title = description.title?.text ?? "";
    this.fixedTicks = description.tickvals?.map((value, i) => [value, description.ticktext[i]]);
    const shown = finite(values).filter((value) => !this.log || value > 0).map((value) => this.own(value));
    let [low, high] = description.range ?? extent(shown);
    if (!description.range) {
      const pad = high > low ? margin * (high - low) : 0.5;
      low -= pad;
      high += pad;
    }
    this.whole = [low, high];
    this.shown = [low, high];
    this.reversed = high < low;
  }

  own(value) {
    return this.log ? Math.log10(value) : value;
  }

  set(from, to) {
    this.from = from;
    this.to = to;
  }

  at(value) {
    const [low, high] = this.shown;
    return this.from + ((this.own(value) - low) / (high - low)) * (this.to - this.from);
  }

  /** The value at a place on the screen. */
  back(place) {
    const [low, high] = this.shown;
    const own = low + ((place - this.from) / (this.to - this.from)) * (high - low);
    return this.log ? 10 ** own : own;
  }

  ticks(most) {
    const [low, high] = [Math.min(...this.shown), Math.max(...this.shown)];
    const inside = ([value]) => this.own(value) >= low - 1e-9 && this.own(value) <= high + 1e-9;
    if (this.fixedTicks) {
      const all = this.fixedTicks.filter(inside);
      return all.length > 1 || !this.log ? all : roundTicks(10 ** low, 10 ** high, most).filter(inside);
    }
    return roundTicks(low, high, most);
  }
}

function extent(values) {
  let low = Infinity;
  let high = -Infinity;
  for (const value of values) {
    if (value < low) low = value;
    if (value > high) high = value;
  }
  return low <= high ? [low, high] : [0, 1];
}

class Drawing {
  constructor(box, { data, layout }) {
    this.box = box;
    this.link = box.dataset.link;
    this.layout = layout;
    this.traces = data.map((trace) => ({ ...trace, axis: trace.yaxis ?? "y" }));
    this.equal = layout.yaxis.scaleanchor !== undefined;
    this.overTime = plain(layout.xaxis.title?.text ?? "").startsWith("time");
    const grids = this.traces.some((trace) => trace.z);
    const marked = this.traces.some((trace) => trace.mode?.startsWith("markers"));
    const xs = this.traces.flatMap((trace) => xValues(trace));
    this.x = new Axis(layout.xaxis, xs, grids ? 0 : this.equal ? 0.06 : marked && !this.overTime ? 0.04 : 0);
    this.parts = Object.keys(layout).filter((key) => key.startsWith("yaxis")).map((key) => {
      const name = key.replace("axis", "");
      const traces = this.traces.filter((trace) => trace.axis === name);
      const values = traces.flatMap((trace) => yValues(trace));
      const axis = new Axis(layout[key], values, traces.some((trace) => trace.z) ? 0 : 0.06);
      const shaded = layout.shapes.filter((shape) => shape.yref === name);
      return { name, axis, traces, shaded, domain: layout[key].domain ?? [0, 1] };
    });
    this.listen();
    this.draw();
  }

  draw() {
    const { box } = this;
    this.width = box.clientWidth;
    this.height = box.clientHeight;
    if (!this.width || !this.height) return;
    this.place();
    const root = svg("svg", { width: this.width, height: this.height });
    const clip = `clip${Drawing.count++}`;
    const cut = svg("clipPath", { id: clip }, svg("defs", {}, root));
    this.heading(root);
    for (const part of this.parts) {
      svg("rect", { x: this.left, y: part.top - 3, width: this.right - this.left, height: part.bottom - part.top + 6 }, cut);
      this.ground(root, part);
    }
    const lines = svg("g", { "clip-path": `url(#${clip})` }, root);
    // colours below lines
    const layers = (part) => [...part.traces].sort((a, b) => Boolean(b.z) - Boolean(a.z));
    for (const part of this.parts) for (const trace of layers(part)) this.trace(lines, part, trace);
    this.foot(root);
    this.cursor = document.createElement("i");
    this.cursor.className = "cursor";
    this.dots = [];
    this.tip = document.createElement("div");
    this.tip.className = "tip";
    this.band = document.createElement("div");
    this.band.className = "band";
    box.replaceChildren(root, this.cursor, this.band, this.tip);
    this.point(Drawing.time);
  }

  /** Where axes and parts stand. */
  place() {
    const { layout, parts } = this;
    const lines = layout.title?.text.split("<br>").length ?? 0;
    const top = 10 + 18 * lines;
    const foot = this.height - 40;
    for (const part of parts) {
      part.top = top + (1 - part.domain[1]) * (foot - top);
      part.bottom = top + (1 - part.domain[0]) * (foot - top);
      part.axis.set(part.bottom, part.top);
      part.ticks = part.axis.ticks((part.bottom - part.top) / 32);
    }
    const widest = Math.max(...parts.flatMap((part) => part.ticks.map(([, words]) => plain(words).length)), 1);
    this.left = (parts.some((part) => part.axis.title) ? 26 : 6) + TICK + LETTER * widest;
    const bar = this.traces.find((trace) => trace.colorbar);
    this.right = this.width - (bar ? 58 : 12);
    this.x.set(this.left, this.right);
    if (this.equal) this.equalise(parts[0]);
  }

  /** One scale for both axes: the one with room to spare shows more. */
  equalise(part) {
    const y = part.axis;
    const wide = Math.abs(this.x.whole[1] - this.x.whole[0]) / (this.right - this.left);
    const high = Math.abs(y.whole[1] - y.whole[0]) / (part.bottom - part.top);
    const zoomed = this.x.shown[0] !== this.x.whole[0] || this.x.shown[1] !== this.x.whole[1];
    if (zoomed && this.zoomed) return;
    const scale = Math.max(wide, high);
    for (const [axis, pixels] of [[this.x, this.right - this.left], [y, part.bottom - part.top]]) {
      const middle = (axis.whole[0] + axis.whole[1]) / 2;
      axis.shown = [middle - (scale * pixels) / 2, middle + (scale * pixels) / 2];
    }
    part.ticks = y.ticks((part.bottom - part.top) / 32);
  }

  heading(root) {
    this.layout.title?.text.split("<br>").forEach((line, i) => {
      rich(svg("text", { x: 0, y: 14 + 18 * i, class: "heading" }, root), line);
    });
  }

  /** Darker stretches, grid, numbers and title of a part. */
  ground(root, part) {
    const { left, right } = this;
    for (const shape of part.shaded) {
      const y = [part.axis.at(shape.y0), part.axis.at(shape.y1)];
      svg("rect", { x: left, width: right - left, y: Math.min(...y), height: Math.abs(y[1] - y[0]), style: "fill: var(--grid)" }, root);
    }
    const grid = svg("g", { class: "grid-lines" }, root);
    for (const [value, words] of part.ticks) {
      const y = round(part.axis.at(value));
      svg("path", { d: `M${left} ${y}H${right}` }, grid);
      svg("path", { d: `M${left} ${y}h-${TICK}`, class: "tick" }, grid);
      rich(svg("text", { x: left - TICK - 3, y: y + 4, "text-anchor": "end" }, root), words);
    }
    part.xTicks = this.x.ticks((right - left) / 74);
    for (const [value] of part.xTicks) svg("path", { d: `M${round(this.x.at(value))} ${part.top}V${part.bottom}` }, grid);
    svg("path", { d: `M${left} ${part.top}V${part.bottom}H${right}`, class: "axis" }, root);
    const middle = (part.top + part.bottom) / 2;
    const title = svg("text", { transform: `translate(13 ${middle}) rotate(-90)`, "text-anchor": "middle" }, root);
    rich(title, part.axis.title);
  }

  /** Numbers and title of the axis at the foot. */
  foot(root) {
    const bottom = Math.max(...this.parts.map((part) => part.bottom));
    const lowest = this.parts.reduce((low, part) => (part.bottom > low.bottom ? part : low));
    let free = -Infinity;
    for (const [value, words] of lowest.xTicks) {
      const x = round(this.x.at(value));
      svg("path", { d: `M${x} ${bottom}v${TICK}`, class: "axis" }, root);
      const half = (LETTER * plain(words).length) / 2;
      if (x - half < free) continue;
      free = x + half + 6;
      rich(svg("text", { x, y: bottom + TICK + 13, "text-anchor": "middle" }, root), words);
    }
    const title = svg("text", { x: (this.left + this.right) / 2, y: bottom + TICK + 30, "text-anchor": "middle" }, root);
    rich(title, this.x.title);
  }

  trace(parent, part, trace) {
    if (trace.z) {
      if (trace.type === "contour") this.contours(parent, part, trace);
      else this.cells(parent, part, trace);
      if (trace.colorbar) this.colourBar(parent.parentNode, part, trace);
      return;
    }
    const group = svg("g", { opacity: trace.opacity ?? 1 }, parent);
    if (trace.mode.startsWith("lines")) {
      const { color, width, dash } = trace.line;
      const dashes = DASHES[dash] ? `; stroke-dasharray: ${DASHES[dash]}` : "";
      svg("path", { d: this.path(trace, part.axis), style: `fill: none; stroke: ${color}; stroke-width: ${width}${dashes}` }, group);
    } else this.marks(group, part.axis, trace);
    this.intervals(group, part.axis, trace);
    const at = trace.text?.length - 1;
    if (at >= 0 && trace.text[at]) this.words(group, part.axis, trace, at);
  }

  path(trace, axis) {
    let path = "";
    let drawing = false;
    for (let i = 0; i < trace.x.length; i++) {
      const x = trace.x[i] === null ? NaN : this.x.at(trace.x[i]);
      const y = trace.y[i] === null ? NaN : axis.at(trace.y[i]);
      const there = Number.isFinite(x) && Number.isFinite(y);
      if (there) path += `${drawing ? "L" : "M"}${round(x)} ${round(y)}`;
      drawing = there;
    }
    return path;
  }

  marks(parent, axis, { x, y, marker }) {
    const r = marker.size / 2;
    const shape = {
      circle: `m${-r} 0a${r} ${r} 0 1 0 ${2 * r} 0a${r} ${r} 0 1 0 ${-2 * r} 0`,
      "triangle-up": `m0 ${-1.1 * r}l${r} ${1.9 * r}h${-2 * r}z`,
      square: `m${-r} ${-r}h${2 * r}v${2 * r}h${-2 * r}z`,
      diamond: `m0 ${-1.2 * r}l${r} ${1.2 * r}l${-r} ${1.2 * r}l${-r} ${-1.2 * r}z`,
      cross: `m${-r / 3} ${-r}h${(2 * r) / 3}v${(2 * r) / 3}h${(2 * r) / 3}v${(2 * r) / 3}h${(-2 * r) / 3}v${(2 * r) / 3}h${(-2 * r) / 3}v${(-2 * r) / 3}h${(-2 * r) / 3}v${(-2 * r) / 3}h${(2 * r) / 3}z`,
      x: `m${-0.7 * r} ${-0.7 * r}l${1.4 * r} ${1.4 * r}m0 ${-1.4 * r}l${-1.4 * r} ${1.4 * r}`,
      "line-ns-open": `m0 ${-r}v${2 * r}`,
    }[marker.symbol];
    const open = marker.symbol === "line-ns-open" || marker.symbol === "x";
    let path = "";
    for (let i = 0; i < x.length; i++) {
      if (x[i] === null || y[i] === null) continue;
      path += `M${round(this.x.at(x[i]))} ${round(axis.at(y[i]))}${shape}`;
    }
    svg("path", { d: path, style: open ? `stroke: ${marker.color}; stroke-width: ${marker.symbol === "x" ? 2 : 1}; fill: none` : `fill: ${marker.color}` }, parent);
  }

  intervals(parent, axis, trace) {
    const bars = trace.error_y ?? trace.error_x;
    if (!bars) return;
    let path = "";
    trace.x.forEach((x, i) => {
      const y = trace.y[i];
      if (x === null || y === null || bars.array[i] === null || bars.arrayminus[i] === null) return;
      if (trace.error_y) path += `M${round(this.x.at(x))} ${round(axis.at(y - bars.arrayminus[i]))}V${round(axis.at(y + bars.array[i]))}`;
      else path += `M${round(this.x.at(x - bars.arrayminus[i]))} ${round(axis.at(y))}H${round(this.x.at(x + bars.array[i]))}`;
    });
    svg("path", { d: path, style: `stroke: ${bars.color}; stroke-width: ${bars.thickness}` }, parent);
  }

  words(parent, axis, trace, i) {
    const [vertical, horizontal] = trace.textposition.split(" ");
    const x = this.x.at(trace.x[i]) + { left: -7, center: 0, right: 7 }[horizontal];
    const y = axis.at(trace.y[i]) + { top: -7, middle: 4, bottom: 15 }[vertical];
    const anchor = { left: "end", center: "middle", right: "start" }[horizontal];
    svg("text", { x, y, "text-anchor": anchor, style: `fill: ${trace.textfont.color}` }, parent).textContent = trace.text[i];
  }

  /** A map of colours: a cell for each value, with its words. */
  cells(parent, part, trace) {
    trace.z.forEach((row, i) => row.forEach((value, j) => {
      if (value === null) return;
      const [x, next] = [this.x.at(j - 0.5), this.x.at(j + 0.5)];
      const [y, below] = [part.axis.at(i + 0.5), part.axis.at(i - 0.5)];
      const share = (value - trace.zmin) / (trace.zmax - trace.zmin || 1);
      const box = { x: x + 0.5, y: y + 0.5, width: Math.max(next - x - 1, 0.5), height: Math.max(below - y - 1, 0.5) };
      svg("rect", { ...box, style: `fill: ${blend(trace.colorscale, share)}; opacity: ${trace.opacity ?? 1}` }, parent);
      if (!trace.text) return;
      svg("text", { x: (x + next) / 2, y: (y + below) / 2 + 4, "text-anchor": "middle" }, parent).textContent = trace.text[i][j];
    }));
  }

  /** Bands of colour between levels, from values on a grid. */
  contours(parent, part, trace) {
    const canvas = document.createElement("canvas");
    canvas.width = Math.round(this.right - this.left);
    canvas.height = Math.round(part.bottom - part.top);
    const pen = canvas.getContext("2d");
    const along = stations(trace.x.map((value) => this.x.at(value) - this.left), canvas.width);
    const up = stations(trace.y.map((value) => part.axis.at(value) - part.top), canvas.height);
    for (let v = 0; v < canvas.height; v++) {
      const [i, b] = up[v];
      for (let u = 0; u < canvas.width; u++) {
        const [j, a] = along[u];
        const low = trace.z[i][j] * (1 - a) + trace.z[i][j + 1] * a;
        const high = trace.z[i + 1][j] * (1 - a) + trace.z[i + 1][j + 1] * a;
        const band = Math.min(Math.floor(low * (1 - b) + high * b), trace.colorscale.length - 1);
        pen.fillStyle = trace.colorscale[Math.max(band, 0)][1];
        pen.fillRect(u, v, 1, 1);
      }
    }
    svg("image", { x: this.left, y: part.top, width: canvas.width, height: canvas.height, href: canvas.toDataURL() }, parent);
  }

  colourBar(root, part, trace) {
    const x = this.right + 8;
    const bar = trace.colorbar;
    const high = part.bottom - part.top;
    const bands = trace.colorscale.length;
    const steps = trace.type === "contour" ? bands : 40;
    for (let i = 0; i < steps; i++) {
      const colour = trace.type === "contour" ? trace.colorscale[i][1] : blend(trace.colorscale, (i + 0.5) / steps);
      svg("rect", { x, width: 10, y: part.bottom - ((i + 1) * high) / steps, height: high / steps + 0.5, style: `fill: ${colour}; opacity: ${trace.opacity ?? 1}` }, root);
    }
    const ticks = bar.tickvals
      ? bar.tickvals.map((value, i) => [value / bands, bar.ticktext[i]])
      : roundTicks(trace.zmin, trace.zmax, high / 40).map(([value, words]) => [(value - trace.zmin) / (trace.zmax - trace.zmin || 1), words]);
    for (const [share, words] of ticks) svg("text", { x: x + 14, y: part.bottom - share * high + 4 }, root).textContent = words;
    if (bar.title) svg("text", { x, y: part.top - 4 }, root).textContent = bar.title.text;
  }

  // ------------------------------------------------------------------------------------------------ pointer

  listen() {
    const { box } = this;
    let start;
    box.addEventListener("pointermove", (event) => {
      const x = event.clientX - box.getBoundingClientRect().left;
      if (start !== undefined && Math.abs(x - start) > 4 && !this.equal) this.select(start, x);
      else this.hover(event);
    });
    box.addEventListener("pointerleave", () => this.leave());
    box.addEventListener("pointerdown", (event) => {
      start = event.clientX - box.getBoundingClientRect().left;
    });
    box.addEventListener("pointerup", (event) => {
      const x = event.clientX - box.getBoundingClientRect().left;
      if (start !== undefined && Math.abs(x - start) > 4 && !this.equal) this.zoom(start, x);
      else if (PLAYS) this.seek(event);
      start = undefined;
    });
    addEventListener("pointerup", () => {
      start = undefined;
    });
    box.addEventListener("dblclick", () => {
      this.x.shown = [...this.x.whole];
      this.draw();
    });
  }

  select(from, to) {
    const [low, high] = [Math.max(Math.min(from, to), this.left), Math.min(Math.max(from, to), this.right)];
    this.band.style.cssText = `display: block; left: ${low}px; width: ${high - low}px`;
  }

  zoom(from, to) {
    const [low, high] = [Math.max(Math.min(from, to), this.left), Math.min(Math.max(from, to), this.right)];
    if (high - low > 4) this.x.shown = [low, high].map((place) => this.x.own(this.x.back(place)));
    this.draw();
  }

  /** The time at a pointer: of the axis, or of the nearest point of a map. */
  timeAt(event) {
    const { left, top } = this.box.getBoundingClientRect();
    const x = event.clientX - left;
    if (this.overTime) return x >= this.left && x <= this.right ? this.x.back(x) : undefined;
    return this.nearest(x, event.clientY - top)?.time;
  }

  seek(event) {
    const time = this.timeAt(event);
    if (time !== undefined) document.dispatchEvent(new CustomEvent("mission:seek", { detail: time }));
  }

  /** The point that is nearest to a place on the screen, within 40 pixels. */
  nearest(x, y) {
    let best = 40;
    let point;
    for (const part of this.parts) {
      for (const trace of part.traces) {
        if (trace.z || trace.hoverinfo === "skip") continue;
        for (let i = 0; i < trace.x.length; i++) {
          if (trace.x[i] === null || trace.y[i] === null) continue;
          const away = Math.hypot(this.x.at(trace.x[i]) - x, part.axis.at(trace.y[i]) - y);
          if (away >= best) continue;
          best = away;
          point = { trace, part, x: trace.x[i], y: trace.y[i], time: trace.customdata?.[i] };
        }
      }
    }
    return point;
  }

  hover(event) {
    const box = this.box.getBoundingClientRect();
    const x = event.clientX - box.left;
    const y = event.clientY - box.top;
    const grid = this.traces.find((trace) => trace.z);
    if (grid) return this.show(x, y, this.cellWords(grid, x, y));
    if (this.equal) {
      const point = this.nearest(x, y);
      if (!point) return this.leave();
      Drawing.follow(this, point.time);
      const time = point.time === undefined ? "" : `, ${short(point.time)} s`;
      return this.show(x, y, [`${nameOf(point.trace)} ${point.x.toFixed(1)} m, ${point.y.toFixed(1)} m${time}`]);
    }
    if (x < this.left || x > this.right) return this.leave();
    const value = this.x.back(x);
    this.line(x);
    if (this.overTime) Drawing.follow(this, value);
    return this.show(x, y, [`${plain(this.x.title).replace(/ \[.*/, "")} ${short(value)}`, ...this.valuesAt(value, x)]);
  }

  /** Names and values of the curves at a place along the axis. */
  valuesAt(value, place) {
    const words = [];
    for (const part of this.parts) {
      for (const trace of part.traces) {
        if (trace.hoverinfo === "skip" || !trace.x.length) continue;
        const i = closest(trace.x, value);
        if (trace.y[i] === null || (trace.marker && Math.abs(this.x.at(trace.x[i]) - place) > 8)) continue;
        words.push(`<b style="color: ${trace.line?.color ?? trace.marker.color}">▬</b> ${nameOf(trace)} ${short(trace.y[i])}`);
      }
    }
    return words.length > 14 ? [...words.slice(0, 13), "…"] : words;
  }

  cellWords(trace, x, y) {
    if (trace.type === "contour") {
      const j = closest(trace.x, this.x.back(x));
      const i = closest(trace.y, this.parts[0].axis.back(y));
      const unit = (axis) => /\[(.+)\]$/.exec(axis.title ?? "")?.[1] ?? "";
      const of = (value, axis) => `${short(value)}${unit(axis) === "°" ? "" : " "}${unit(axis)}`;
      const place = `${of(trace.x[j], this.x)}, ${of(trace.y[i], this.parts[0].axis)}`;
      return [`${place}: ${short(trace.customdata[i][j] ?? NaN)} m`];
    }
    const row = trace.hovertext[Math.round(this.parts[0].axis.back(y))];
    const words = row?.[Math.round(this.x.back(x))];
    return words ? words.split("<br>") : [];
  }

  show(x, y, lines) {
    if (!lines.length) return this.leave();
    this.tip.innerHTML = lines.join("<br>");
    this.tip.style.display = "block";
    const wide = this.tip.offsetWidth;
    const left = x + 14 + wide > this.width ? x - wide - 12 : x + 14;
    this.tip.style.transform = `translate(${Math.max(0, left)}px, ${Math.max(0, Math.min(y - 10, this.height - this.tip.offsetHeight))}px)`;
    return undefined;
  }

  leave() {
    this.tip.style.display = "none";
    Drawing.follow(this, undefined);
    this.point(Drawing.time);
  }

  line(x) {
    const top = Math.min(...this.parts.map((part) => part.top));
    const bottom = Math.max(...this.parts.map((part) => part.bottom));
    const inside = x >= this.left - 0.5 && x <= this.right + 0.5;
    this.cursor.style.cssText = inside ? `display: block; height: ${bottom - top}px; transform: translate(${round(x)}px, ${top}px)` : "";
  }

  /** Show a time: by a line over time, by dots on a map. */
  point(time) {
    if (!this.cursor) return;
    if (time === undefined) {
      this.cursor.style.cssText = "";
      for (const dot of this.dots) dot.style.display = "none";
    } else if (this.overTime) this.line(this.x.at(time));
    else if (this.equal) this.dotsAt(time);
  }

  dotsAt(time) {
    const timed = this.parts[0].traces.filter((trace) => trace.customdata && trace.x.length > 1);
    timed.forEach((trace, n) => {
      if (!this.dots[n]) {
        this.dots[n] = document.createElement("i");
        this.dots[n].className = "dot-at";
        this.dots[n].style.background = trace.line?.color ?? trace.marker.color;
        this.box.append(this.dots[n]);
      }
      const i = closest(trace.customdata, time);
      const there = trace.x[i] !== null && trace.y[i] !== null;
      this.dots[n].style.display = there ? "block" : "none";
      if (there) this.dots[n].style.transform = `translate(${round(this.x.at(trace.x[i]))}px, ${round(this.parts[0].axis.at(trace.y[i]))}px)`;
    });
  }
}
Drawing.count = 0;
Drawing.all = new Set();

/** Show the time under the pointer in the other figures of a link; undefined: that of the scene again. */
Drawing.follow = (from, time) => {
  if (!from.link) return;
  for (const other of Drawing.all) if (other !== from && other.link === from.link) other.point(time ?? Drawing.time);
};

const nameOf = (trace) => plain(/<extra>(.*)<\/extra>/.exec(trace.hovertemplate ?? "")?.[1] ?? "");

/** Index of the value of increasing ones that is nearest to another. */
function closest(values, value) {
  let low = 0;
  let high = values.length - 1;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (values[middle] < value) low = middle + 1;
    else high = middle;
  }
  return low > 0 && value - values[low - 1] < values[low] - value ? low - 1 : low;
}

/** For each pixel the index of the interval of grid places that it lies in, and how far in it. */
function stations(places, pixels) {
  const rising = places[places.length - 1] > places[0];
  return Array.from({ length: pixels }, (_, p) => {
    let i = 0;
    while (i < places.length - 2 && (rising ? places[i + 1] < p : places[i + 1] > p)) i++;
    return [i, Math.min(Math.max((p - places[i]) / (places[i + 1] - places[i]), 0), 1)];
  });
}

function blend(scale, share) {
  const percent = (100 * Math.min(Math.max(share, 0), 1)).toFixed(1);
  return `color-mix(in srgb, ${scale[scale.length - 1][1]} ${percent}%, ${scale[0][1]})`;
}

/** Values that an axis has to show: of curves with the ends of their intervals, of maps the edges of cells. */
function xValues(trace) {
  if (trace.type === "heatmap") return [-0.5, trace.z[0].length - 0.5];
  return withBars(trace.x, trace.error_x);
}

function yValues(trace) {
  if (trace.type === "heatmap") return [-0.5, trace.z.length - 0.5];
  return withBars(trace.y, trace.error_y);
}

function withBars(values, bars) {
  if (!bars) return values;
  return values.concat(values.map((value, i) => value + bars.array[i]), values.map((value, i) => value - bars.arrayminus[i]));
}

const boxes = [...document.querySelectorAll(".plot")];
const drawings = new Map();
let figures = []; // what is drawn in each box, when the page has inflated it
function draw(box) {
  if (drawings.has(box)) return;
  const drawing = new Drawing(box, figures[box.dataset.figure]);
  drawings.set(box, drawing);
  Drawing.all.add(drawing);
  new ResizeObserver(() => {
    if (drawing.width !== box.clientWidth) drawing.draw();
  }).observe(box);
}
document.addEventListener("mission:time", (event) => {
  Drawing.time = event.detail;
  for (const drawing of Drawing.all) if (drawing.seen) drawing.point(event.detail);
});
addEventListener("beforeprint", () => figures.length && boxes.forEach(draw));
const seen = new IntersectionObserver((entries) => entries.forEach(({ target, isIntersecting }) => {
  if (isIntersecting) draw(target);
  const drawing = drawings.get(target);
  if (!drawing) return;
  drawing.seen = isIntersecting;
  if (isIntersecting) drawing.point(Drawing.time);
}), { rootMargin: "300px" });
(async () => {
  const packed = Uint8Array.from(atob(document.getElementById("figure-data").textContent), (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate-raw"));
  figures = JSON.parse(await new Response(stream).text());
  boxes.forEach((box) => seen.observe(box));
  setTimeout(drawNext, 500);
})();
// the rest, one by one, for whom takes the page as a whole: a saved one, a picture of it, a search
function drawNext() {
  const box = boxes.find((each) => !drawings.has(each));
  if (!box) return;
  draw(box);
  setTimeout(drawNext, 20);
}
