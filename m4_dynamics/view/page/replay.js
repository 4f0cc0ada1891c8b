const replay = JSON.parse(document.getElementById("replay").textContent);
const parts = replay.parts.map((text) => atob(text));
for (const command of replay.commands) {
  const bytes = command.map((part) => parts[part]).join("");
  viewer.handle_command_bytearray(Uint8Array.from(bytes, (letter) => letter.charCodeAt(0)));
}

// meshcat's own controls are there for those who want them: folded away, the animation's folder open inside.
viewer.gui.__folders.Scene.close();
viewer.gui.width = 250;
viewer.gui.close();
const moving = replay.times.length > 1; // else it is a still scene, such as a gallery of postures

const animator = viewer.animator;
const element = (id) => document.getElementById(id);

// ---- words ----------------------------------------------------------------------------------------------------------
for (const fact of replay.conditions) {
  const item = document.createElement("li");
  item.textContent = fact;
  element("conditions").append(item);
}
element("scale").textContent = replay.scale;
show_legend(replay.legend);
const cells = replay.readouts.map((readout) => {
  const [name, value] = [document.createElement("dt"), document.createElement("dd")];
  name.textContent = readout.label;
  element("readouts").append(name, value);
  return value;
});

const bars = replay.phases.map((phase) => {
  const bar = document.createElement("button");
  bar.type = "button";
  bar.title = `${phase.label}, from ${(replay.start_time + phase.start).toFixed(1)} s`;
  bar.setAttribute("aria-label", bar.title);
  bar.style.flex = `${phase.end - phase.start} 0 0`;
  bar.style.background = phase.colour;
  bar.addEventListener("click", () => seek(phase.start));
  element("phases").append(bar);
  return bar;
});
element("phase").hidden = bars.length === 0;

function show_phase(time) {
  let index = replay.phases.findIndex((phase) => time < phase.end - 1e-6);
  if (index < 0) index = bars.length - 1;
  bars.forEach((bar, row) => bar.setAttribute("aria-current", row === index));
  document.querySelector("#phase span").style.background = replay.phases[index].colour;
  document.querySelector("#phase output").textContent = replay.phases[index].label;
}

// ---- camera ---------------------------------------------------------------------------------------------------------
// three.js has y up: its (x, y, z) is the world's (x, z, -y).
const THREE = MeshCat.THREE;
const to_three = (place) => new THREE.Vector3(place[0], place[2], -place[1]);
const look = to_three(replay.camera.direction).normalize();
viewer.camera.fov = replay.camera.field_of_view;
viewer.camera.near = 0.05;
viewer.camera.far = 500;

function frame_box(low, high) {
  // The nearest place from which every corner of the box is in sight, above the timeline and below the top edge.
  const target = to_three(low).add(to_three(high)).multiplyScalar(0.5);
  const right = new THREE.Vector3(0, 1, 0).cross(look).normalize();
  const up = look.clone().cross(right);
  const half_height = Math.tan((viewer.camera.fov * Math.PI) / 360) * 0.84;
  const half_width = half_height * (window.innerWidth / window.innerHeight);
  let distance = 0;
  for (let corner = 0; corner < 8; corner += 1) {
    const place = to_three([0, 1, 2].map((axis) => ((corner >> axis) & 1 ? high : low)[axis])).sub(target);
    const towards = place.dot(look);
    distance = Math.max(
      distance, towards + Math.abs(place.dot(up)) / half_height, towards + Math.abs(place.dot(right)) / half_width);
  }
  viewer.controls.target.copy(target);
  viewer.camera.position.copy(target).addScaledVector(look, distance);
  viewer.set_dirty();
}

const root = replay.camera.root ? node(replay.camera.root) : null;
const root_place = () => to_three(root.position.toArray());
let following = null; // where the robot was when the camera last moved with it

function overview() {
  following = null;
  element("follow").setAttribute("aria-pressed", "false");
  frame_box(replay.camera.low, replay.camera.high);
}

function follow() {
  const centre = root.position.toArray();
  frame_box(centre.map((entry) => entry - 0.65), centre.map((entry) => entry + 0.65));
  following = root_place();
  element("follow").setAttribute("aria-pressed", "true");
}

// ---- labels ---------------------------------------------------------------------------------------------------------
const labels = replay.labels.map((entry) => {
  const [label, detail] = [document.createElement("div"), document.createElement("span")];
  label.className = "label";
  label.textContent = entry.text;
  detail.textContent = entry.detail;
  label.append(detail);
  document.body.insertBefore(label, element("facts"));
  return { label, place: to_three(entry.place) };
});

function place_labels() {
  for (const { label, place } of labels) {
    const seen = place.clone().project(viewer.camera);
    label.hidden = seen.z > 1;
    const [x, y] = [0.5 * (seen.x + 1) * window.innerWidth, 0.5 * (1 - seen.y) * window.innerHeight];
    label.style.transform = `translate(-50%, 0) translate(${x.toFixed(1)}px, ${y.toFixed(1)}px)`;
  }
}

// ---- playback -------------------------------------------------------------------------------------------------------
const seek = (time) => {
  animator.pause();
  animator.seek(time);
  animator.display_progress(Math.max(0, Math.min(animator.duration, time)));
};
const toggle = () => (animator.playing ? animator.pause() : animator.play());
element("seek").max = animator.duration;
element("seek").addEventListener("input", (event) => seek(Number(event.target.value)));
element("play").addEventListener("click", toggle);
element("speed").addEventListener("change", (event) => { animator.mixer.timeScale = Number(event.target.value); });
element("overview").addEventListener("click", overview);
element("follow").addEventListener("click", () => (following ? overview() : follow()));
window.addEventListener("resize", () => { if (!following) overview(); });
document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || /INPUT|SELECT|BUTTON/.test(event.target.tagName)) return;
  const step = 1 / replay.frames_per_second;
  const action = moving ? {
    " ": toggle, f: () => (following ? overview() : follow()), o: overview,
    ArrowRight: () => seek(animator.time + step), ArrowLeft: () => seek(animator.time - step),
  }[event.key] : { o: overview }[event.key];
  if (action) { event.preventDefault(); action(); }
});

let shown = { time: -1, playing: null };
function refresh() {
  requestAnimationFrame(refresh);
  if (following) {
    const place = root_place();
    const step = place.clone().sub(following);
    if (step.lengthSq() > 0) {
      viewer.controls.target.add(step);
      viewer.camera.position.add(step);
      viewer.set_dirty();
      following = place;
    }
  }
  if (shown.playing !== animator.playing) {
    element("play").textContent = animator.playing ? "❚❚" : "▶";
    element("play").setAttribute("aria-label", animator.playing ? "Pause" : "Play");
  }
  if (labels.length) place_labels();
  if (moving && shown.time !== animator.time) {
    const last = replay.times.length - 1;
    const index = Math.min(last, Math.max(0, Math.round(animator.time * replay.frames_per_second)));
    element("clock").textContent =
      `${(replay.start_time + animator.time).toFixed(2)} / ${(replay.start_time + animator.duration).toFixed(2)} s`;
    if (bars.length) show_phase(animator.time);
    if (document.activeElement !== element("seek") || animator.playing) element("seek").value = animator.time;
    replay.readouts.forEach((readout, row) => {
      const value = readout.values[index];
      cells[row].textContent = value === null ? "–" : `${value.toFixed(readout.digits)} ${readout.unit}`;
    });
  }
  shown = { time: animator.time, playing: animator.playing };
}

element("timeline").hidden = !moving;
document.body.classList.toggle("still", !moving);
if (replay.camera.follow) follow(); else overview();
if (window.matchMedia("(prefers-reduced-motion: reduce)").matches) animator.pause();
refresh();
