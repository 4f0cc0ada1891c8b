"use strict";
// A click on a cell: links to its reports, and the commands that make one or show the cell in 3D.
const map = JSON.parse(document.getElementById("map-cells").textContent);

const nearest = (values, wanted) =>
  values.reduce((best, value, k) => (Math.abs(value - wanted) < Math.abs(values[best] - wanted) ? k : best), 0);

function line(...parts) {
  const paragraph = document.createElement("p");
  paragraph.append(...parts);
  return paragraph;
}

function command(words, place) {
  const code = document.createElement("code");
  code.textContent = `m4 ${words} ${map.subject}${place.map(([name, value]) => ` --${name} ${+value.toPrecision(8)}`).join("")}`;
  return code;
}

function link(report) {
  const anchor = document.createElement("a");
  anchor.href = report.href;
  anchor.textContent = report.words;
  return anchor;
}

function show(sheet, row, column) {
  const [slope, thrust, friction] = [map.slopes[column], map.thrusts[row], map.frictions[sheet]];
  const strong = document.createElement("strong");
  strong.textContent = `${+slope.toPrecision(4)}°, ${+thrust.toPrecision(4)} N, μₛ ${+friction.toPrecision(4)}`;
  const lines = [line(strong)];
  const start = map.starts[sheet][row][column]; // the one that ended worst; null without an equilibrium
  if (start === null) lines.push(line("No equilibrium to start from: there is nothing to replay."));
  else {
    const place = [["slope", slope], ["thrust", thrust], ["friction", friction]];
    if (start > 0) place.push(["start", start]);
    const reports = map.reports.filter((one) => one.sheet === sheet && one.row === row && one.column === column);
    lines.push(reports.length ? line("Report: ", ...reports.map(link)) : line("Write its report: ", command("map replay", place)));
    lines.push(line("Look at it in 3D: ", command("view", place)));
  }
  document.getElementById("cell").replaceChildren(...lines);
}

const plot = document.getElementById("plot");
plot.on("plotly_click", ({ points: [at] }) =>
  show(plot.layout.sliders[0].active, nearest(map.thrusts, at.y), nearest(map.slopes, at.x)));
