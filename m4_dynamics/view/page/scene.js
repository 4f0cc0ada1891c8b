"use strict";
const viewer = new MeshCat.Viewer(document.getElementById("pane"));
// A screen reader meets the canvas as a picture with a name; what it shows in figures stands in the cards.
viewer.renderer.domElement.setAttribute("role", "img");
viewer.renderer.domElement.setAttribute("aria-label", `3D picture: ${document.title}`);

// What the legend switches is shown or hidden by three.js itself: nothing of it is an animation's business.
const PICTURES = {
  arrow: '<path d="M0 6H20M18 1L29 6L18 11Z" stroke="currentColor" stroke-width="3" fill="currentColor"/>',
  dot: '<circle cx="15" cy="6" r="5.5" fill="currentColor"/>',
  cone: '<path d="M15 12L3 2A12 2 0 0 1 27 2Z" fill="currentColor" fill-opacity="0.35" stroke="currentColor"/>',
  trail: '<path d="M1 10C9 10 12 3 28 2" stroke="currentColor" stroke-width="3" fill="none"/>',
  pendulum: '<circle cx="8" cy="7" r="4.3" stroke="currentColor" stroke-width="2" fill="none"/><path d="M8 7L24 3" stroke="currentColor" stroke-width="2.5"/><circle cx="24" cy="3" r="3" fill="currentColor"/>',
  ghost: '<rect x="4" y="1" width="22" height="10" rx="4" fill="currentColor" fill-opacity="0.4" stroke="currentColor"/>',
};
const node = (path) => viewer.scene_tree.find(path.split("/").filter((step) => step)).object;
function show(entry, visible) {
  for (const path of entry.nodes) node(path).visible = visible;
  viewer.set_dirty();
}
function show_legend(entries) {
  const list = document.querySelector("#legend ul");
  list.replaceChildren();
  for (const entry of entries) {
    const [item, label, box] = ["li", "label", "input"].map((name) => document.createElement(name));
    box.type = "checkbox";
    box.checked = entry.shown;
    box.addEventListener("change", () => show(entry, box.checked));
    label.innerHTML = `<svg viewBox="0 0 30 12" aria-hidden="true">${PICTURES[entry.kind]}</svg>`;
    label.querySelector("svg").style.color = entry.colour;
    label.prepend(box);
    label.append(entry.text);
    item.append(label);
    list.append(item);
    show(entry, entry.shown);
  }
  document.getElementById("legend").open = window.innerWidth > 720;
}
