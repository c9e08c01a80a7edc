// What the viewer does: camera, keys, buttons, the timeline; and the start of it all.

function turn(yaw, pitch) {
  camera.yaw += yaw;
  camera.pitch = clamp(camera.pitch + pitch, -0.4, 1.5);
  invalidate();
}

function zoom(factor) {
  camera.zoom = clamp(camera.zoom * factor, 0.3, 6);
  invalidate();
}

function look(yaw) {
  Object.assign(camera, { yaw, pitch: 0.15, zoom: 1 });
  invalidate();
}

function makeOrbit(canvas) {
  const pointers = new Map();
  const spread = () => {
    const [a, b] = [...pointers.values()];
    return Math.hypot(a.x - b.x, a.y - b.y) || 1;
  };
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
  });
  canvas.addEventListener("pointermove", (event) => {
    const last = pointers.get(event.pointerId);
    if (!last) return;
    const before = pointers.size === 2 ? spread() : 0;
    pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    if (pointers.size === 2) zoom(spread() / before);
    else turn((last.x - event.clientX) * 0.01, (event.clientY - last.y) * 0.01);
  });
  for (const kind of ["pointerup", "pointercancel"]) {
    canvas.addEventListener(kind, (event) => pointers.delete(event.pointerId));
  }
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    zoom(Math.exp(-event.deltaY * 0.0015));
  }, { passive: false });
}

function changeSpeed(direction) {
  const list = byId("speed");
  list.selectedIndex = clamp(list.selectedIndex + direction, 0, list.options.length - 1);
  setSpeed();
}

function setSpeed() {
  if (playing) readTime();
  if (audio) audio.playbackRate = Number(byId("speed").value);
}

function changeSpan(direction) {
  if (!clip) return;
  timeline.changeSpan(direction);
  // The cursor keeps its place in the stretch as well as it can.
  timeline.start = clamp(time - timeline.span / 2, 0, Math.max(0, timeline.seconds - timeline.span));
  showSpan();
}

const KEYS = {
  " ": () => (playing ? pause() : play()),
  ArrowLeft: (event) => seek(time - (event.shiftKey ? 5 : 1)),
  ArrowRight: (event) => seek(time + (event.shiftKey ? 5 : 1)),
  ",": () => step(-1),
  ".": () => step(1),
  Home: () => seek(0),
  End: () => clip && seek(seconds()),
  "+": () => zoom(1.2),
  "=": () => zoom(1.2),
  "-": () => zoom(1 / 1.2),
  a: () => turn(0.15, 0),
  d: () => turn(-0.15, 0),
  w: () => turn(0, 0.1),
  s: () => turn(0, -0.1),
  "[": () => changeSpeed(-1),
  "]": () => changeSpeed(1),
  l: () => byId("loop").click(),
};

// Keys work inside the player only, and leave to buttons and lists what is theirs.
player.addEventListener("keydown", (event) => {
  const action = KEYS[event.key];
  const tag = event.target.tagName;
  if (!action || event.ctrlKey || event.metaKey || event.altKey) return;
  if (tag === "SELECT" || tag === "SUMMARY") return;
  if (event.key === " " && (tag === "BUTTON" || event.target.type === "checkbox")) return;
  event.preventDefault();
  action(event);
});

function listen() {
  const clicks = {
    play: KEYS[" "], back: KEYS[","], forward: KEYS["."], closer: KEYS["+"], farther: KEYS["-"],
    front: () => look(0), side: () => look(Math.PI / 2), narrower: () => changeSpan(-1), wider: () => changeSpan(1),
    previous: () => openClip(Number(byId("clip").value) - 1), next: () => openClip(Number(byId("clip").value) + 1),
  };
  for (const [id, action] of Object.entries(clicks)) byId(id).addEventListener("click", action);
  byId("clip").addEventListener("change", () => openClip(Number(byId("clip").value)));
  byId("told").addEventListener("change", () => tellTrace(Number(byId("told").value)));
  byId("speed").addEventListener("change", setSpeed);
  byId("seek").addEventListener("input", () => clip && seek(Number(byId("seek").value) / clip.fps));
  byId("choice").addEventListener("change", changeChoice);
  for (const button of document.querySelectorAll(".open")) {
    button.addEventListener("click", () => {
      openClip(Number(button.dataset.clip));
      player.scrollIntoView({ block: "start" });
      player.focus({ preventScroll: true });
    });
  }
  const canvas = byId("timeline");
  const toPointer = (event) => {
    const box = canvas.getBoundingClientRect();
    if (clip) seek(timeline.timeAt(event.clientX - box.left, event.clientY - box.top));
  };
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    toPointer(event);
  });
  canvas.addEventListener("pointermove", (event) => canvas.hasPointerCapture(event.pointerId) && toPointer(event));
}

function readColours() {
  const style = getComputedStyle(document.documentElement);
  colours = Object.fromEntries(COLOUR_NAMES.map((name) => [name, style.getPropertyValue(name).trim()]));
  timeline.stale = true;
  invalidate();
}

readColours();
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", readColours);
new ResizeObserver(invalidate).observe(player);
listen();
if (byId("clip").options.length) openClip(0);
