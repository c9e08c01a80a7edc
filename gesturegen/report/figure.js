// A stick figure on a canvas: decoding its joint positions, the camera, the drawing.

const SIDE_COLOURS = { l: "--left", r: "--right", m: "--middle" };
const REACH = 3.2; // the camera's distance, in figures
const GRID_LINES = 5; // to each side of the figure

function bytesOf(base64) {
  const text = atob(base64);
  const bytes = new Uint8Array(text.length);
  for (let k = 0; k < text.length; k++) bytes[k] = text.charCodeAt(k);
  return bytes;
}

async function inflate(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

// Differences in time, low bytes before high bytes, back to steps [frame][joint][axis].
async function decodeMotion(packed) {
  const bytes = await inflate(bytesOf(packed.data));
  const channels = packed.parents.length * 3;
  const total = packed.frames * channels;
  if (bytes.length !== 2 * total) throw new Error("the motion " + packed.label + " is damaged");
  const steps = new Int16Array(total);
  for (let channel = 0, k = 0; channel < channels; channel++) {
    let value = 0;
    for (let place = channel; place < total; place += channels, k++) {
      value += bytes[k] | (bytes[total + k] << 8);
      steps[place] = value; // wraps to 16 bits by itself
    }
  }
  return Object.assign({}, packed, { data: null, steps, path: pelvisPath(packed, steps) });
}

// Where the camera looks on the ground: the pelvis, averaged over a second, so that steps do not shake the view.
function pelvisPath(packed, steps) {
  const { frames, pelvis, step, centre } = packed;
  const joints = packed.parents.length;
  const half = Math.round(packed.fps / 2);
  const path = new Float32Array(frames * 2);
  for (const [k, axis] of [[0, 0], [1, 2]]) {
    const sums = new Float64Array(frames + 1);
    for (let f = 0; f < frames; f++) sums[f + 1] = sums[f] + steps[(f * joints + pelvis) * 3 + axis];
    for (let f = 0; f < frames; f++) {
      const from = Math.max(0, f - half);
      const to = Math.min(frames, f + half + 1);
      path[2 * f + k] = centre[axis] + (step * (sums[to] - sums[from])) / (to - from);
    }
  }
  return path;
}

// The canvas in device pixels; true when its size changed.
function fitCanvas(canvas) {
  const scale = window.devicePixelRatio || 1;
  const width = Math.max(1, Math.round(canvas.clientWidth * scale));
  const height = Math.max(1, Math.round(canvas.clientHeight * scale));
  if (canvas.width === width && canvas.height === height) return false;
  canvas.width = width;
  canvas.height = height;
  return true;
}

// A function from world coordinates to [x, y, scale] on a canvas of the given size.
function projection(motion, frame, camera, width, height) {
  const turn = motion.facing + camera.yaw;
  const sine = Math.sin(turn), cosine = Math.cos(turn);
  const up = Math.sin(camera.pitch), level = Math.cos(camera.pitch);
  const size = motion.size;
  // Coming closer goes up to the chest: that is where the gestures are.
  const middle = Math.min(0.74, 0.53 + 0.45 * Math.max(0, 1 - 1 / camera.zoom));
  const [tx, ty, tz] = [motion.path[2 * frame], motion.floor + middle * size, motion.path[2 * frame + 1]];
  const distance = REACH * size;
  const whole = (0.72 * camera.zoom * Math.min(height, width * 1.6)) / size;
  return (x, y, z) => {
    const dx = x - tx, dy = y - ty, dz = z - tz;
    const across = dx * cosine - dz * sine;
    const towards = dx * sine + dz * cosine;
    const depth = Math.max(0.15 * size, distance - towards * level - dy * up);
    const scale = (whole * distance) / depth;
    return [width / 2 + across * scale, height / 2 - (dy * level - towards * up) * scale, scale];
  };
}

function drawGround(pen, motion, frame, project, colours) {
  const step = motion.size * 0.3;
  const [cx, cz] = [0, 1].map((k) => Math.round(motion.path[2 * frame + k] / step) * step);
  const reach = GRID_LINES * step;
  pen.strokeStyle = colours["--grid"];
  pen.lineWidth = Math.max(1, window.devicePixelRatio || 1);
  pen.beginPath();
  for (let k = -GRID_LINES; k <= GRID_LINES; k++) {
    for (const [from, to] of [
      [[cx + k * step, cz - reach], [cx + k * step, cz + reach]],
      [[cx - reach, cz + k * step], [cx + reach, cz + k * step]],
    ]) {
      pen.moveTo(...project(from[0], motion.floor, from[1]).slice(0, 2));
      pen.lineTo(...project(to[0], motion.floor, to[1]).slice(0, 2));
    }
  }
  pen.stroke();
}

function drawFigure(canvas, motion, frame, camera, colours) {
  const pen = canvas.getContext("2d");
  const { width, height } = canvas;
  pen.clearRect(0, 0, width, height);
  frame = Math.min(frame, motion.frames - 1);
  const project = projection(motion, frame, camera, width, height);
  drawGround(pen, motion, frame, project, colours);
  const joints = motion.parents.length;
  const points = [];
  for (let j = 0, k = frame * joints * 3; j < joints; j++, k += 3) {
    const at = [0, 1, 2].map((axis) => motion.centre[axis] + motion.step * motion.steps[k + axis]);
    points.push(project(...at));
  }
  pen.lineCap = "round";
  // The scale grows towards the viewer: what is near is drawn last.
  const bones = [...motion.parents.keys()].filter((j) => motion.parents[j] >= 0);
  bones.sort((a, b) => points[a][2] - points[b][2]);
  for (const j of bones) {
    const [from, to] = [points[motion.parents[j]], points[j]];
    pen.strokeStyle = colours[SIDE_COLOURS[motion.sides[j]]];
    pen.lineWidth = Math.max(1, to[2] * motion.size * (motion.thin[j] === "1" ? 0.005 : 0.017));
    pen.beginPath();
    pen.moveTo(from[0], from[1]);
    pen.lineTo(to[0], to[1]);
    pen.stroke();
  }
  if (motion.head >= 0) drawHead(pen, motion, points, colours);
  canvas.dataset.frame = frame;
}

// A circle that sits on the head joint, away from the neck.
function drawHead(pen, motion, points, colours) {
  const head = points[motion.head];
  const neck = motion.parents[motion.head] >= 0 ? points[motion.parents[motion.head]] : [head[0], head[1] + 1];
  const radius = 0.06 * motion.size * head[2];
  const [dx, dy] = [head[0] - neck[0], head[1] - neck[1]];
  const length = Math.hypot(dx, dy) || 1;
  pen.strokeStyle = colours["--middle"];
  pen.lineWidth = Math.max(1, head[2] * motion.size * 0.012);
  pen.beginPath();
  pen.arc(head[0] + (dx / length) * radius, head[1] + (dy / length) * radius, radius, 0, 2 * Math.PI);
  pen.stroke();
}
