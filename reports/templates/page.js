for (const table of document.querySelectorAll("table")) {
  const body = table.tBodies[0];
  const heads = [...table.tHead.lastElementChild.cells];
  const key = (row, i) => row.cells[i].dataset.key ?? row.cells[i].textContent;
  heads.forEach((head, i) => head.firstElementChild.addEventListener("click", () => {
    const down = head.getAttribute("aria-sort") === "ascending";
    const rows = [...body.rows];
    const value = (row) => (key(row, i) === "inf" ? Infinity : Number(key(row, i)));
    const numeric = rows.every((row) => !Number.isNaN(value(row)));
    rows.sort((a, b) => (numeric ? value(a) - value(b) || 0 : key(a, i).localeCompare(key(b, i), "en", { numeric: true })));
    if (down) rows.reverse();
    heads.forEach((other) => other.removeAttribute("aria-sort"));
    head.setAttribute("aria-sort", down ? "descending" : "ascending");
    body.append(...rows);
  }));
}
// Figures: drawn when they come into view, in the colours of the theme; panels with one data-link share a time cursor.
const plots = [...document.querySelectorAll(".plot")];
const drawn = new Set();
function draw(div) {
  const style = getComputedStyle(document.documentElement);
  const text = div.previousElementSibling.textContent;
  const figure = JSON.parse(text.replace(/var\((--\w+)\)/g, (_, name) => style.getPropertyValue(name).trim()));
  Plotly.react(div, figure.data, figure.layout, { displayModeBar: false, responsive: true });
  if (!drawn.has(div) && div.dataset.link) {
    div.on("plotly_hover", ({ points: [point] }) => {
      const time = point.customdata ?? (isMap(div) ? undefined : point.x);
      if (time !== undefined) follow(div, time);
    });
    div.on("plotly_unhover", () => follow(div));
  }
  drawn.add(div);
}
const isMap = (div) => div.layout.yaxis.scaleanchor !== undefined;
let following = false;
function follow(from, time) {
  if (following) return;
  following = true;
  for (const div of drawn) {
    if (div === from || div.dataset.link !== from.dataset.link) continue;
    if (time === undefined) Plotly.Fx.unhover(div);
    else Plotly.Fx.hover(div, div.data.flatMap((trace, curveNumber) => {
      const times = trace.customdata ?? (isMap(div) ? [] : trace.x);
      if (trace.hoverinfo === "skip" || times.length < 2) return [];
      const after = times.findIndex((at) => at >= time);
      return [{ curveNumber, pointNumber: after < 0 ? times.length - 1 : after }];
    }), [...new Set(div.data.map((trace) => `x${trace.yaxis ?? "y"}`))]);
  }
  following = false;
}
const all = () => plots.forEach(draw);
matchMedia("screen and (prefers-color-scheme: dark)").addEventListener("change", all);
addEventListener("beforeprint", () => plots.filter((div) => !drawn.has(div)).forEach(draw));
const seen = new IntersectionObserver((entries) => entries.filter((entry) => entry.isIntersecting).forEach((entry) => {
  seen.unobserve(entry.target);
  draw(entry.target);
}), { rootMargin: "600px" });
plots.forEach((div) => seen.observe(div));
