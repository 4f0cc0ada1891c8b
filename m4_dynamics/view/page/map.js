"use strict";
const content = JSON.parse(document.getElementById("content").textContent);
const plot = document.getElementById("map");
const said = document.getElementById("cell");

function code(command) {
  const words = document.createElement("code");
  words.textContent = command;
  return words;
}

function link(report) {
  const anchor = document.createElement("a");
  anchor.href = report.link;
  anchor.textContent = `report (${report.label})`;
  return anchor;
}

const near = (a, b) => Math.abs(a - b) <= 1e-6 * Math.max(1, Math.abs(a));

if (content.arguments !== null) {
  said.textContent = "Click a cell for its report, or for the command that makes one.";
  plot.on("plotly_click", (event) => {
    const at = event.points[0];
    const friction = content.frictions[plot.layout.sliders[0].active];
    const place = Object.entries({ slope: at.x, thrust: at.y, friction })
      .map(([name, value]) => ` --${name} ${+value.toPrecision(8)}`).join("");
    const there = content.reports.filter((one) => near(one.x, at.x) && near(one.y, at.y) && near(one.friction, friction));
    const ways = there.length
      ? there.flatMap((one) => [link(one), ", "])
      : ["make the report: ", code(`m4 map replay ${content.arguments}${place}`), ", "];
    said.replaceChildren("This cell: ", ...ways, "see it in 3D: ", code(`m4 view ${content.arguments}${place}`));
  });
}
