"use strict";
const element = (id) => document.getElementById(id);

async function unpack(id) {
  const letters = element(id).textContent.trim();
  if (!letters) return null;
  const bytes = Uint8Array.from(atob(letters), (letter) => letter.charCodeAt(0));
  return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).text();
}

// ---- replay ---------------------------------------------------------------------------------------------------------
let frame = null;
let linked = true; // whether a moved cursor shall move the replay
async function start_replay() {
  element("start").disabled = true;
  element("start").textContent = "starting …";
  frame = document.createElement("iframe");
  frame.title = "3D replay of the run";
  frame.srcdoc = await unpack("replay-page");
  element("stage").replaceChildren(frame);
  element("stage").classList.add("on");
  frame.focus();
}
if (element("replay-page").textContent.trim()) {
  element("watch").hidden = false;
  element("start").addEventListener("click", start_replay);
}
addEventListener("message", (event) => {
  if (frame && event.source === frame.contentWindow && typeof event.data.replay_time === "number") {
    linked = false;
    move_cursor(event.data.replay_time);
    linked = true;
  }
});

// ---- plots ----------------------------------------------------------------------------------------------------------
const SVG = "http://www.w3.org/2000/svg";
const HEIGHT = 190;
const EDGE = { left: 52, right: 8, top: 10, bottom: 22 };
let plots = null;
let shown = [0, 1]; // the range of time in sight
let cursor = null;
const panels = [];

function draw(parent, name, attributes, text) {
  const one = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) one.setAttribute(key, value);
  if (text !== undefined) one.textContent = text;
  parent.append(one);
  return one;
}

const number = (value) => {
  if (value === null || value === undefined) return "–";
  const size = Math.abs(value);
  if (size !== 0 && (size >= 1e5 || size < 1e-3)) return value.toExponential(1).replace(".0e", "e").replaceAll("-", "−").replace("+", "");
  return String(Number(value.toPrecision(4))).replace("-", "−");
};

function ticks(low, high, count) {
  const rough = (high - low) / count;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((one) => one * power).find((one) => one >= rough * 0.999);
  const places = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k += 1) places.push(k * step);
  return places;
}

const before = (time) => { // the sample at or after a time
  let [low, high] = [0, plots.time.length - 1];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (plots.time[middle] < time) low = middle + 1; else high = middle;
  }
  return low;
};

function redraw(panel) {
  const { svg, data } = panel;
  const width = Math.max(svg.clientWidth, 200);
  svg.setAttribute("viewBox", `0 0 ${width} ${HEIGHT}`);
  svg.replaceChildren();
  panel.cursor = null;
  const [from, to] = shown;
  const first = Math.max(before(from) - 1, 0);
  const last = Math.min(before(to) + 1, plots.time.length);
  const scale = data.logarithmic ? Math.log10 : (value) => value;
  let [low, high] = [Infinity, -Infinity];
  const take = (value) => { low = Math.min(low, value); high = Math.max(high, value); };
  for (const curve of data.curves) {
    for (let k = first; k < last; k += 1) if (curve.values[k] !== null) take(scale(curve.values[k]));
  }
  if (low > high) [low, high] = [0, 1];
  const span = high - low;
  // A limit is shown where the curves come near it; one far away would only flatten them.
  for (const [value] of data.limits) {
    const place = scale(value);
    if (data.logarithmic || (place > low - 1.2 * span && place < high + 1.2 * span)) take(place);
  }
  if (high - low < 1e-9 * Math.max(1, Math.abs(high))) { low -= 0.5; high += 0.5; }
  const room = 0.05 * (high - low);
  low -= room; high += room;
  const x = (time) => EDGE.left + ((time - from) / (to - from)) * (width - EDGE.left - EDGE.right);
  const y = (value) => HEIGHT - EDGE.bottom - ((value - low) / (high - low)) * (HEIGHT - EDGE.top - EDGE.bottom);
  panel.time_at = (place) => from + ((place - EDGE.left) / (width - EDGE.left - EDGE.right)) * (to - from);
  panel.x = x;
  const clip = `clip${panels.indexOf(panel)}`;
  const inside = { x: EDGE.left, y: EDGE.top, width: width - EDGE.left - EDGE.right, height: HEIGHT - EDGE.top - EDGE.bottom };
  draw(draw(svg, "clipPath", { id: clip }), "rect", inside);
  const plot = draw(svg, "g", { "clip-path": `url(#${clip})` });
  for (const phase of plots.phases) {
    const wide = Math.max(x(phase.end) - x(phase.start), 0);
    draw(plot, "rect", { x: x(phase.start), y: EDGE.top, width: wide, height: inside.height, fill: phase.colour, opacity: 0.13 });
  }
  const marks = data.logarithmic && high - low > 1.2
    ? ticks(low, high, 4).filter((one) => Number.isInteger(Math.round(one * 1e6) / 1e6)) : ticks(low, high, 4);
  for (const mark of marks) {
    draw(svg, "line", { class: "grid", x1: EDGE.left, x2: width - EDGE.right, y1: y(mark), y2: y(mark) });
    const label = number(data.logarithmic ? Number((10 ** mark).toPrecision(2)) : Number(mark.toPrecision(10)));
    draw(svg, "text", { x: EDGE.left - 6, y: y(mark) + 4, "text-anchor": "end" }, label);
  }
  for (const mark of ticks(from, to, Math.max(3, width / 75))) {
    draw(svg, "line", { class: "grid", x1: x(mark), x2: x(mark), y1: EDGE.top, y2: HEIGHT - EDGE.bottom });
    const anchor = x(mark) > width - 22 ? "end" : "middle";
    draw(svg, "text", { x: Math.min(x(mark), width - 2), y: HEIGHT - 6, "text-anchor": anchor }, `${number(Number(mark.toPrecision(10)))} s`);
  }
  svg.append(plot); // over the grid
  for (const [value, name] of data.limits) {
    const place = y(scale(value));
    if (place < EDGE.top - 1 || place > HEIGHT - EDGE.bottom + 1) continue;
    draw(plot, "line", { class: "limit", x1: EDGE.left, x2: width - EDGE.right, y1: place, y2: place });
    draw(plot, "text", { x: width - EDGE.right - 3, y: place < EDGE.top + 16 ? place + 14 : place - 4, "text-anchor": "end" },
      `${name} ${number(value)}`);
  }
  // Of the samples that fall on one column the least and the largest are drawn: no peak is lost.
  const stride = Math.max(1, Math.floor((last - first) / (width * 1.5)));
  data.curves.forEach((curve, row) => {
    let path = "";
    let broken = true;
    for (let k = first; k < last; k += stride) {
      let [least, most] = [null, null];
      for (let j = k; j < Math.min(k + stride, last); j += 1) {
        if (curve.values[j] === null) continue;
        if (least === null || curve.values[j] < curve.values[least]) least = j;
        if (most === null || curve.values[j] > curve.values[most]) most = j;
      }
      if (least === null) { broken = true; continue; }
      for (const j of least === most ? [least] : [Math.min(least, most), Math.max(least, most)]) {
        path += `${broken ? "M" : "L"}${x(plots.time[j]).toFixed(1)} ${y(scale(curve.values[j])).toFixed(1)}`;
        broken = false;
      }
    }
    draw(plot, "path", { class: `curve c${row}${curve.dashed ? " dashed" : ""}`, d: path });
  });
  panel.plot = plot;
  place_cursor(panel);
}

function place_cursor(panel) {
  if (!panel.cursor) {
    panel.cursor = draw(panel.plot, "line", { class: "cursor", y1: EDGE.top, y2: HEIGHT - EDGE.bottom });
  }
  panel.cursor.setAttribute("visibility", cursor === null ? "hidden" : "visible");
  if (cursor === null) return;
  panel.cursor.setAttribute("x1", panel.x(cursor));
  panel.cursor.setAttribute("x2", panel.x(cursor));
  const sample = before(cursor);
  panel.outputs.forEach((output, row) => { output.textContent = number(panel.data.curves[row].values[sample]); });
}

function move_cursor(time) {
  if (!plots || !plots.time.length) return;
  const end = plots.time[plots.time.length - 1];
  cursor = Math.min(Math.max(time, plots.time[0]), end);
  const phase = plots.phases.findLast((one) => cursor >= one.start - 1e-6);
  element("clock").textContent = `t = ${cursor.toFixed(2)} s${phase ? `, ${phase.label}` : ""}`;
  panels.forEach(place_cursor);
  if (linked && frame && frame.contentWindow) frame.contentWindow.postMessage({ seek: cursor }, "*");
}

function show(from, to) {
  const [start, end] = [plots.time[0], plots.time[plots.time.length - 1]];
  const length = Math.min(Math.max(to - from, 0.05), end - start);
  const low = Math.min(Math.max(from, start), end - length);
  shown = [low, low + length];
  panels.forEach(redraw);
}
const all = () => show(plots.time[0], plots.time[plots.time.length - 1]);
function zoom(factor) {
  const middle = cursor !== null && cursor >= shown[0] && cursor <= shown[1] ? cursor : (shown[0] + shown[1]) / 2;
  show(middle - (middle - shown[0]) * factor, middle + (shown[1] - middle) * factor);
}

function listen(panel) {
  const { svg } = panel;
  const time = (event) => panel.time_at(event.clientX - svg.getBoundingClientRect().left);
  let pressed = null;
  let chosen = null;
  svg.addEventListener("pointerdown", (event) => {
    if (event.pointerType === "mouse" && event.button === 0) {
      pressed = time(event);
      svg.setPointerCapture(event.pointerId);
    }
    move_cursor(time(event));
  });
  svg.addEventListener("pointermove", (event) => {
    const now = time(event);
    if (pressed !== null) {
      if (!chosen) chosen = draw(panel.plot, "rect", { class: "chosen", y: EDGE.top, height: HEIGHT - EDGE.top - EDGE.bottom });
      const [low, high] = [Math.min(pressed, now), Math.max(pressed, now)].map(panel.x);
      chosen.setAttribute("x", low);
      chosen.setAttribute("width", high - low);
    }
    // A mouse that only passes shows values; it does not drag the replay along.
    linked = pressed !== null || event.pointerType !== "mouse";
    move_cursor(now);
    linked = true;
  });
  svg.addEventListener("pointerup", (event) => {
    const now = time(event);
    if (chosen && pressed !== null && Math.abs(panel.x(now) - panel.x(pressed)) > 6) {
      show(Math.min(pressed, now), Math.max(pressed, now));
    } else if (chosen) chosen.remove();
    [pressed, chosen] = [null, null];
  });
  svg.addEventListener("dblclick", all);
  svg.addEventListener("keydown", (event) => {
    const step = (shown[1] - shown[0]) / (event.shiftKey ? 10 : 100);
    const now = cursor === null ? shown[0] : cursor;
    const action = {
      ArrowLeft: () => move_cursor(now - step), ArrowRight: () => move_cursor(now + step),
      Home: () => move_cursor(shown[0]), End: () => move_cursor(shown[1]),
      "+": () => zoom(0.5), "=": () => zoom(0.5), "-": () => zoom(2), 0: all, Escape: all,
    }[event.key];
    if (action && !event.ctrlKey && !event.metaKey && !event.altKey) { event.preventDefault(); action(); }
  });
}

function make_panel(data) {
  const figure = document.createElement("figure");
  const caption = document.createElement("figcaption");
  const name = document.createElement("b");
  name.textContent = data.unit ? `${data.title} [${data.unit}]` : data.title;
  caption.append(name);
  const outputs = data.curves.map((curve, row) => {
    const key = document.createElement("span");
    key.className = "key";
    const line = document.createElement("i");
    line.className = `c${row}${curve.dashed ? " dashed" : ""}`;
    const output = document.createElement("output");
    output.setAttribute("aria-live", "off");
    key.append(line, curve.label, " ", output);
    caption.append(key);
    return output;
  });
  const finite = data.curves[0].values.filter((value) => value !== null);
  const [least, most] = finite.reduce(([low, high], value) => [Math.min(low, value), Math.max(high, value)], [Infinity, -Infinity]);
  const svg = document.createElementNS(SVG, "svg");
  svg.setAttribute("role", "img");
  svg.setAttribute("tabindex", "0");
  svg.setAttribute("aria-label",
    `${data.title}. ${data.about} ${data.curves[0].label}: from ${number(least)} to ${number(most)} ${data.unit}.`);
  figure.title = data.about;
  figure.append(caption, svg);
  element("panels").append(figure);
  const panel = { data, svg, outputs, cursor: null };
  panels.push(panel);
  listen(panel);
}

async function start_plots() {
  plots = JSON.parse(await unpack("plot-data"));
  if (!plots.time.length) return;
  element("plots").hidden = false;
  for (const phase of plots.phases) {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = phase.label;
    button.style.borderLeftColor = phase.colour;
    button.addEventListener("click", () => { show(phase.start, phase.end); move_cursor(phase.start); });
    element("phases").append(button);
  }
  plots.panels.forEach(make_panel);
  all();
  element("clock").textContent = `${number(plots.time[0])} to ${number(plots.time[plots.time.length - 1])} s`;
  element("closer").addEventListener("click", () => zoom(0.5));
  element("wider").addEventListener("click", () => zoom(2));
  element("all").addEventListener("click", all);
  addEventListener("resize", () => panels.forEach(redraw));
}
if ("DecompressionStream" in window) start_plots();
else {
  element("watch").hidden = true;
  document.querySelector("main").prepend("This browser is too old to draw the plots; the figures are below.");
}
