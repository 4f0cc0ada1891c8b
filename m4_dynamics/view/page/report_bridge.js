// Runs inside the embedded replay: it and the report tell each other the time.
let told = -1;
function tell() {
  requestAnimationFrame(tell);
  if (animator.time === told) return;
  told = animator.time;
  parent.postMessage({ replay_time: replay.start_time + told }, "*");
}
addEventListener("message", (event) => {
  if (event.source === parent && typeof event.data.seek === "number") seek(event.data.seek - replay.start_time);
});
tell();
