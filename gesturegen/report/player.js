// The player: one clip is decoded at a time, its audio drives the time, everything else follows.

const MOST_SHOWN = 3;
const COLOUR_NAMES = [
  "--paper", "--ink", "--soft", "--grid", "--left", "--right", "--middle", "--accent", "--shade", "--shade-2",
  "--keyword", "--fallback", "--wave", "--natural",
];
const byId = (id) => document.getElementById(id);
const make = (tag, properties = {}) => Object.assign(document.createElement(tag), properties);
const clamp = (value, low, high) => Math.min(Math.max(value, low), high);

const player = byId("player");
const timeline = new Timeline(byId("timeline"));
const camera = { yaw: 0, pitch: 0.15, zoom: 1 };
const hidden = new Set(); // labels of motions that are switched off, kept from clip to clip
let colours = {};
let clip = null; // the open one, decoded
let stages = []; // { canvas, motion } of the motions shown
let told = null; // the trace on the timeline
let audio = null; // null where the clip has no sound, or the browser cannot play it
let time = 0;
let playing = false;
let clock = 0; // when the time was last read, for clips without sound
let drawnFrame = -1;
let dirty = true;
let waiting = false; // a frame has been asked of the browser
let opening = 0; // counts calls of openClip: only the last one may finish

// --- opening and freeing ---

async function openClip(place) {
  const turn = ++opening;
  free();
  player.dataset.state = "opening";
  byId("clip").value = String(place);
  byId("previous").disabled = place === 0;
  byId("next").disabled = place === byId("clip").options.length - 1;
  for (const button of document.querySelectorAll(".open")) {
    button.setAttribute("aria-current", String(Number(button.dataset.clip) === place));
  }
  try {
    await arrived(place);
    const packed = JSON.parse(byId(`clip-${place}`).textContent);
    const shown = choose(packed.motions);
    const decoded = await Promise.all(packed.motions.map((motion) => (shown.includes(motion) ? decodeMotion(motion) : motion)));
    if (turn !== opening) return;
    if (packed.audio) {
      packed.peaks = bytesOf(packed.audio.peaks);
      openAudio(packed);
      packed.audio.ogg = null;
    }
    clip = Object.assign(packed, { motions: decoded });
    showClip(shown.map((motion) => packed.motions.find((other) => other.label === motion.label)));
    player.dataset.state = "ready";
  } catch (error) {
    if (turn !== opening) return;
    player.dataset.state = "failed";
    tell(`This clip cannot be shown: ${error.message}`);
  }
}

// The first clip stands before this script in the file; the others may still be on their way.
async function arrived(place) {
  if (place > 0 && document.readyState === "loading") {
    await new Promise((resolve) => document.addEventListener("DOMContentLoaded", resolve, { once: true }));
  }
}

// Everything decoded goes before the next clip comes, so that only one is in memory.
function free() {
  pause();
  if (audio) {
    const address = audio.src;
    audio.removeAttribute("src");
    audio.load();
    URL.revokeObjectURL(address);
  }
  [clip, audio, told, stages] = [null, null, null, []];
  timeline.clip = timeline.trace = null;
  byId("stages").replaceChildren();
  tell("");
}

function openAudio(packed) {
  audio = new Audio(URL.createObjectURL(new Blob([bytesOf(packed.audio.ogg)], { type: "audio/ogg" })));
  audio.preload = "auto";
  audio.playbackRate = Number(byId("speed").value);
  audio.addEventListener("ended", atEnd);
  audio.addEventListener("error", (event) => event.target === audio && withoutSound());
}

function withoutSound() {
  if (!audio) return;
  audio = null;
  clock = performance.now();
  tell("This browser cannot play the sound of this clip; the motion plays without it.");
}

function tell(text) {
  byId("message").textContent = text;
  byId("message").hidden = !text;
}

function choose(motions) {
  const wanted = motions.filter((motion) => !hidden.has(motion.label)).slice(0, MOST_SHOWN);
  return wanted.length ? wanted : motions.slice(0, 1);
}

function showClip(shown) {
  time = 0;
  byId("seek").max = String(clip.frames - 1);
  showChoice(shown);
  showStages(shown);
  const traced = clip.motions.filter((motion) => motion.trace);
  const names = traced.map((motion, k) => make("option", { value: String(k), textContent: motion.label }));
  byId("told").replaceChildren(...names);
  byId("told").hidden = byId("told-label").hidden = traced.length < 2;
  byId("notes").replaceChildren(...clip.notes.map((note) => make("li", { textContent: note })));
  tellTrace(0);
}

function showChoice(shown) {
  const boxes = clip.motions.map((motion) => {
    const box = make("input", { type: "checkbox", checked: shown.includes(motion), value: motion.label });
    const wrapped = make("label");
    wrapped.append(box, ` ${motion.label}`);
    return wrapped;
  });
  byId("choice").replaceChildren(...(clip.motions.length > 1 ? boxes : []));
  limitChoice();
}

function limitChoice() {
  const boxes = [...byId("choice").querySelectorAll("input")];
  const checked = boxes.filter((box) => box.checked).length;
  for (const box of boxes) box.disabled = box.checked ? checked === 1 : checked >= MOST_SHOWN;
}

async function changeChoice() {
  const open = clip;
  const boxes = [...byId("choice").querySelectorAll("input")];
  for (const box of boxes) box.checked ? hidden.delete(box.value) : hidden.add(box.value);
  limitChoice();
  const shown = [];
  for (const [k, motion] of open.motions.entries()) {
    if (!boxes[k].checked) continue;
    if (!motion.steps) {
      const decoded = await decodeMotion(motion);
      if (clip !== open) return;
      // Two quick changes may decode the same motion twice; the first one stays.
      if (!open.motions[k].steps) open.motions[k] = decoded;
    }
    shown.push(open.motions[k]);
  }
  showStages(shown);
}

function showStages(shown) {
  stages = shown.map((motion) => {
    const canvas = make("canvas", { tabIndex: 0 });
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", `Stick figure, ${motion.label}; drag to turn, wheel or pinch to zoom`);
    makeOrbit(canvas);
    return { canvas, motion };
  });
  byId("stages").replaceChildren(
    ...stages.map(({ canvas, motion }) => {
      const frame = make("figure");
      frame.append(make("figcaption", { textContent: motion.label }), canvas);
      return frame;
    }),
  );
  // The canvases have to have their size before they are drawn on.
  invalidate();
}

function tellTrace(place) {
  const traced = clip.motions.filter((motion) => motion.trace);
  told = traced.length ? traced[place].trace : null;
  const scale = Number(player.dataset.joinScale) || 1;
  byId("scale-end").textContent = scale.toFixed(scale < 10 ? 1 : 0);
  const several = told && told.references.length > 1;
  const named = several ? told.references.slice(0, REFERENCE_COLOURS.length) : [];
  const texts = named.map((name, k) => {
    const item = make("span", { textContent: ` ${name}` });
    const patch = make("i");
    patch.style.background = REFERENCE_COLOURS[k];
    item.prepend(patch);
    return item;
  });
  byId("reference-legend").replaceChildren(...(several ? ["source: ", ...texts] : []));
  showControl(told ? told.control : []);
  timeline.open(clip, told, scale, timeline.clip === clip ? timeline.span : 0);
  showSpan();
  invalidate();
}

// What was asked of the hands and what was achieved, where anything was.
function showControl(control) {
  for (const part of player.querySelectorAll(".control")) part.hidden = !control.length;
  const rows = control.map(({ cells }) => {
    const row = make("tr");
    row.append(make("th", { scope: "row", textContent: cells[0] }));
    row.append(...cells.slice(1).map((textContent) => make("td", { textContent })));
    return row;
  });
  byId("control").tBodies[0].replaceChildren(...rows);
}

function showSpan() {
  byId("span").textContent = `${timeline.span.toFixed(0)} of ${timeline.seconds.toFixed(0)} s`;
  byId("narrower").disabled = timeline.span <= SPANS[0];
  byId("wider").disabled = timeline.span >= timeline.seconds;
  invalidate();
}

// --- time ---

const seconds = () => clip.frames / clip.fps;
const frameAt = (at) => clamp(Math.floor(at * clip.fps + 1e-6), 0, clip.frames - 1);

function play() {
  if (!clip || playing) return;
  if (frameAt(time) >= clip.frames - 1) seek(0);
  playing = true;
  clock = performance.now();
  if (audio) {
    const sound = audio;
    sound.currentTime = time;
    sound.play().catch((error) => {
      // Pausing before the sound has begun ends in an error too, which is none.
      if (sound === audio && error.name !== "AbortError") withoutSound();
    });
  }
  showPlaying();
}

function pause() {
  if (!playing) return;
  readTime();
  playing = false;
  if (audio) audio.pause();
  showPlaying();
}

function showPlaying() {
  byId("play").textContent = playing ? "Pause" : "Play";
  byId("play").setAttribute("aria-pressed", String(playing));
  // A text that changes thirty times a second is not to be read aloud.
  byId("readout").setAttribute("aria-live", playing ? "off" : "polite");
  player.dataset.playing = String(playing);
  invalidate();
}

function readTime() {
  const now = performance.now();
  if (audio) time = audio.currentTime;
  else time += ((now - clock) / 1000) * Number(byId("speed").value);
  clock = now;
  time = Math.min(time, seconds());
}

function seek(to) {
  if (!clip) return;
  time = clamp(to, 0, (clip.frames - 0.5) / clip.fps);
  clock = performance.now();
  if (audio) audio.currentTime = time;
  invalidate();
}

function step(frames) {
  if (!clip) return;
  pause();
  seek(clamp(frameAt(time) + frames, 0, clip.frames - 1) / clip.fps);
}

function atEnd() {
  if (!clip || !playing) return;
  if (byId("loop").checked) {
    seek(0);
    if (audio) audio.play().catch(() => {});
  } else {
    pause();
    seek(seconds());
  }
}

// --- drawing ---

function invalidate() {
  dirty = true;
  ask();
}

function ask() {
  if (waiting) return;
  waiting = true;
  requestAnimationFrame(() => {
    waiting = false;
    if (!clip) return;
    if (playing) {
      readTime();
      if (!audio && time >= seconds()) atEnd();
    }
    if (dirty || frameAt(time) !== drawnFrame) draw();
    if (playing) ask();
  });
}

function draw() {
  dirty = false;
  drawnFrame = frameAt(time);
  for (const { canvas, motion } of stages) {
    fitCanvas(canvas);
    drawFigure(canvas, motion, drawnFrame, camera, colours);
  }
  timeline.draw(time, colours);
  byId("seek").value = String(drawnFrame);
  byId("seek").setAttribute("aria-valuetext", `${time.toFixed(2)} seconds, frame ${drawnFrame}`);
  byId("time").textContent = `${time.toFixed(2)} of ${seconds().toFixed(2)} s`;
  byId("readout").textContent = describe(drawnFrame);
  player.dataset.frame = drawnFrame;
}

function describe(frame) {
  const parts = [`${(frame / clip.fps).toFixed(2)} s`, `frame ${frame} of ${clip.frames}`];
  if (told) {
    const place = told.pieces.findIndex(([start, end]) => frame >= start && frame < end);
    if (place >= 0) {
      const [, , kind, keyword, fallback] = told.pieces[place];
      // GestureMaster's pieces say what they are, all others how they end.
      const whole = kind === "clip" || kind === "rest";
      const what = whole ? kind : `ends at ${kind === "keyword" ? `keyword “${keyword}”` : kind}`;
      const gave = fallback ? `, fallback: ${fallback}` : "";
      parts.push(`piece ${place + 1} of ${told.pieces.length} (${what}${gave})`);
    }
    parts.push(`shows ${told.references[told.reference[frame]]}, frame ${told.source[frame]}`);
  }
  const word = nearestWord(frame / clip.fps);
  if (word) parts.push(`word “${word[0]}”${word[3] ? ` (keyword ${word[3]})` : ""}`);
  const join = told && told.joins.find(([at]) => at === frame);
  if (join) parts.push(`join here: ${join[2] ? "natural" : `distance ${join[1].toFixed(1)}`}`);
  return parts.join(" · ");
}

function nearestWord(at) {
  const gap = ([, start, end]) => Math.max(start - at, at - end, 0);
  return clip.words.reduce((best, word) => (!best || gap(word) < gap(best) ? word : best), null);
}
