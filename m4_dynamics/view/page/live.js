const element = (id) => document.getElementById(id);
const THREE = MeshCat.THREE;
viewer.gui.close();
viewer.gui.width = 250;
viewer.camera.fov = 30;
let now = 0;
let ended = false;

// three.js has y up: its (x, y, z) is the world's (x, z, -y). The camera goes with the robot; the reader may turn it.
let followed = null;
function follow() {
  const place = node(element("pane").dataset.root).position;
  const seen = new THREE.Vector3(place.x, place.z, -place.y);
  if (followed) {
    viewer.camera.position.add(seen).sub(followed);
    viewer.controls.target.add(seen).sub(followed);
  } else {
    viewer.controls.target.copy(seen);
    // A narrow window sees less to either side, so it looks from farther away.
    const distance = Math.max(1, 1.25 * (window.innerHeight / window.innerWidth));
    viewer.camera.position.copy(seen).addScaledVector(new THREE.Vector3(-1.2, 1.3, 3.6), distance);
  }
  followed = seen;
  viewer.set_dirty();
}

function tell(status) {
  element("status").textContent = status;
  element("status").hidden = !status;
}

function draw(commands) {
  const view = new DataView(commands);
  for (let start = 0; start < commands.byteLength;) {
    const size = view.getUint32(start, true);
    viewer.handle_command_bytearray(new Uint8Array(commands.slice(start + 4, start + 4 + size)));
    start += 4 + size;
  }
}

function read(words) {
  if (words.legend) {
    show_legend(words.legend);
    element("scale").textContent = words.scale;
    element("legend").hidden = false;
    return;
  }
  if (words.ended) {
    ended = true;
    tell("the run has ended");
    return;
  }
  now = words.time;
  tell("");
  element("phase").hidden = !words.phase;
  document.querySelector("#phase output").textContent = words.phase;
  element("readouts").replaceChildren(...words.readouts.flatMap(([label, value]) => {
    const [name, figure] = [document.createElement("dt"), document.createElement("dd")];
    name.textContent = label;
    figure.textContent = value;
    return [name, figure];
  }));
  follow();
  requestAnimationFrame(() => channel.readyState === 1 && channel.send("drawn"));
}

const channel = new WebSocket("ws://" + location.host + "/channel");
channel.binaryType = "arraybuffer";
channel.onmessage = ({ data }) => (typeof data === "string" ? read(JSON.parse(data)) : draw(data));
channel.onclose = () => { if (!ended) tell("the connection was lost"); };
