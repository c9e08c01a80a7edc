// The timeline under the figures: an overview of the whole clip, and a stretch of it in detail.

const REFERENCE_COLOURS = ["#2e8bd0", "#e0731d", "#1a9e77", "#c970a8", "#b58900", "#7c83e8", "#8f9aa3", "#a8704a"];
const DISTANCE_COLOURS = [[59, 76, 192], [127, 127, 176], [200, 135, 154], [232, 117, 92], [215, 48, 31]];
const SPANS = [2, 5, 10, 20, 30, 60, 120, 300];
const GUTTER = 48;
// Rows from the top: name, top and height in CSS pixels.
const ROWS = {
  all: [4, 26], sound: [38, 44], words: [88, 22], pieces: [114, 24], joins: [144, 30], source: [180, 84],
};
// Below them a row for each demand on the hands, from the first one's top, and then the axis.
const BELOW = 266;
const CONTROL_ROW = 66;
const AXIS_ROW = 24;

function distanceColour(share) {
  const place = Math.min(Math.max(share, 0), 1) * (DISTANCE_COLOURS.length - 1);
  const k = Math.min(Math.floor(place), DISTANCE_COLOURS.length - 2);
  const mixed = DISTANCE_COLOURS[k].map((low, c) => Math.round(low + (place - k) * (DISTANCE_COLOURS[k + 1][c] - low)));
  return `rgb(${mixed.join(",")})`;
}

class Timeline {
  constructor(canvas) {
    this.canvas = canvas;
    this.picture = document.createElement("canvas"); // everything but the cursor
    this.clip = null;
  }

  open(clip, trace, joinScale, span) {
    Object.assign(this, { clip, trace, joinScale, seconds: clip.frames / clip.fps, start: 0 });
    this.control = trace ? trace.control : [];
    this.axis = BELOW + CONTROL_ROW * this.control.length;
    this.canvas.style.height = `${this.axis + AXIS_ROW}px`;
    this.setSpan(span || this.readableSpan());
  }

  // So long that words can be read, at about 70 pixels a second, but never a glimpse.
  readableSpan() {
    const room = (this.canvas.clientWidth - GUTTER) / 70;
    return SPANS.filter((span) => span <= Math.max(room, 5)).pop();
  }

  setSpan(span) {
    this.span = Math.min(span, this.seconds);
    this.stale = true;
  }

  changeSpan(direction) {
    const longer = SPANS.filter((span) => span > this.span && span < this.seconds).concat(this.seconds);
    const shorter = SPANS.filter((span) => span < this.span);
    this.setSpan(direction > 0 ? longer[0] : shorter.length ? shorter.pop() : this.span);
  }

  // The stretch moves by pages, when the cursor leaves it: no steady scrolling.
  follow(time) {
    const last = Math.max(0, this.seconds - this.span);
    if (time >= this.start && time < this.start + this.span && this.start <= last) return;
    this.start = Math.min(last, Math.max(0, time - 0.08 * this.span));
    this.stale = true;
  }

  x(time) {
    return GUTTER + ((time - this.start) / this.span) * (this.width - GUTTER);
  }

  overviewX(time) {
    return GUTTER + (time / this.seconds) * (this.width - GUTTER);
  }

  // The time under a point; the overview spans the whole clip.
  timeAt(x, y) {
    const share = Math.min(1, Math.max(0, (x - GUTTER) / (this.width - GUTTER)));
    return y < ROWS.all[0] + ROWS.all[1] + 4 ? share * this.seconds : this.start + share * this.span;
  }

  draw(time, colours) {
    if (!this.clip) return;
    this.follow(time);
    if (fitCanvas(this.canvas)) this.stale = true;
    this.width = this.canvas.clientWidth;
    if (this.stale) this.drawPicture(colours);
    const pen = this.canvas.getContext("2d");
    const scale = this.canvas.width / this.width;
    pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.clearRect(0, 0, this.canvas.width, this.canvas.height);
    pen.drawImage(this.picture, 0, 0);
    pen.setTransform(scale, 0, 0, scale, 0, 0);
    pen.fillStyle = colours["--ink"];
    pen.fillRect(this.x(time) - 0.75, ROWS.sound[0] - 4, 1.5, this.axis - ROWS.sound[0] + 6);
    pen.fillRect(this.overviewX(time) - 0.75, ROWS.all[0], 1.5, ROWS.all[1]);
  }

  drawPicture(colours) {
    this.picture.width = this.canvas.width;
    this.picture.height = this.canvas.height;
    this.colours = colours;
    const pen = (this.pen = this.picture.getContext("2d"));
    const scale = this.canvas.width / this.width;
    pen.setTransform(scale, 0, 0, scale, 0, 0);
    pen.textBaseline = "middle";
    this.drawOverview();
    pen.save();
    pen.beginPath();
    pen.rect(GUTTER, 0, this.width - GUTTER, this.axis + AXIS_ROW);
    pen.clip();
    this.control.forEach((demand, k) => this.drawWhen(demand, BELOW + k * CONTROL_ROW));
    this.drawAxis();
    this.drawWave(ROWS.sound, this.start, this.span);
    this.drawOnsets();
    this.drawWords();
    if (this.trace) {
      this.drawPieces();
      this.drawJoins();
      this.drawSource();
    }
    this.control.forEach((demand, k) => this.drawDemand(demand, BELOW + k * CONTROL_ROW));
    pen.restore();
    this.drawLabels();
    this.stale = false;
  }

  drawLabels() {
    const { pen, colours } = this;
    pen.font = "11px system-ui, sans-serif";
    pen.fillStyle = colours["--soft"];
    pen.textAlign = "left";
    for (const name of Object.keys(ROWS)) {
      if (!this.trace && ["pieces", "joins", "source"].includes(name)) continue;
      const [top, height] = ROWS[name];
      pen.fillText(name, 5, name === "source" ? top + 8 : top + height / 2);
    }
    if (!this.trace) return;
    // The source row's own axis: frames of the reference.
    pen.font = "10px system-ui, sans-serif";
    const [top, height] = ROWS.source;
    pen.textAlign = "right";
    pen.fillText(String(this.mostSource()), GUTTER - 4, top + 24);
    pen.fillText("0", GUTTER - 4, top + height - 5);
    this.control.forEach((demand, k) => this.drawControlLabels(demand, BELOW + k * CONTROL_ROW));
  }

  // What a row is about and in which unit, and the ends of its scale.
  drawControlLabels({ name, hand, unit, values, low, high }, top) {
    const { pen } = this;
    const [least, most] = this.controlRange(values, low, high);
    pen.textAlign = "left";
    [name, hand, unit].filter(Boolean).forEach((text, line) => pen.fillText(text, 5, top + 20 + 12 * line));
    pen.textAlign = "right";
    pen.fillText(most.toFixed(0), GUTTER - 4, top + 8);
    pen.fillText(least.toFixed(0), GUTTER - 4, top + CONTROL_ROW - 7);
  }

  // The values that a row spans; the whole clip's, so that the scale stays when the stretch moves.
  controlRange(values, low, high) {
    const bounds = [low, high].filter((bound) => bound !== null);
    const all = (pick, first) => values.reduce((found, value) => pick(found, value), first);
    const least = all(Math.min, Math.min(...bounds));
    const most = all(Math.max, Math.max(...bounds));
    return most > least ? [least, most] : [least - 1, least + 1];
  }

  mostSource() {
    return this.trace.source.reduce((most, frame) => Math.max(most, frame), 1);
  }

  drawAxis() {
    const { pen, colours } = this;
    const top = this.axis;
    const tick = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 30, 60, 120].find((t) => (t / this.span) * (this.width - GUTTER) > 55) || 300;
    pen.font = "10px system-ui, sans-serif";
    pen.textAlign = "center";
    for (let k = Math.ceil(this.start / tick - 1e-9); k * tick <= this.start + this.span + 1e-9; k++) {
      const x = this.x(k * tick);
      pen.fillStyle = colours["--grid"];
      pen.fillRect(x, ROWS.sound[0] - 4, 1, top - ROWS.sound[0] + 4);
      pen.fillStyle = colours["--soft"];
      const text = `${Math.round(k * tick * 10) / 10} s`;
      pen.fillText(text, Math.min(Math.max(x, GUTTER + 14), this.width - 16), top + 10);
    }
  }

  drawWave([top, height], start, span) {
    const { pen, colours, clip } = this;
    if (!clip.peaks) return;
    const perSecond = clip.audio.peaks_per_second;
    const columns = this.width - GUTTER;
    pen.fillStyle = colours["--wave"];
    for (let column = 0; column < columns; column++) {
      const from = Math.floor((start + (column / columns) * span) * perSecond);
      const to = Math.max(from + 1, Math.floor((start + ((column + 1) / columns) * span) * perSecond));
      let loudest = 0;
      for (let k = from; k < to && k < clip.peaks.length; k++) loudest = Math.max(loudest, clip.peaks[k]);
      const tall = Math.max(1, (height * loudest) / 255);
      pen.fillRect(GUTTER + column, top + (height - tall) / 2, 1, tall);
    }
  }

  drawOverview() {
    const { pen, colours, trace, clip } = this;
    const [top, height] = ROWS.all;
    if (this.span < this.seconds) {
      pen.fillStyle = colours["--shade"];
      pen.fillRect(this.overviewX(this.start), top - 2, this.overviewX(this.span) - GUTTER, height + 4);
    }
    this.drawWave(ROWS.all, 0, this.seconds);
    if (!trace) return;
    pen.fillStyle = colours["--fallback"];
    for (const [start, end, , , fallback] of trace.pieces) {
      if (!fallback) continue;
      const x = this.overviewX(start / clip.fps);
      pen.fillRect(x, top + height - 3, Math.max(1, this.overviewX(end / clip.fps) - x), 3);
    }
  }

  drawOnsets() {
    const { pen, colours, clip } = this;
    const [top, height] = ROWS.sound;
    pen.fillStyle = colours["--accent"];
    for (const time of clip.onsets) pen.fillRect(this.x(time) - 0.75, top - 2, 1.5, height + 4);
  }

  // Text cut to the room it has; nothing where there is no room for three letters.
  fitText(text, room) {
    if (this.pen.measureText(text).width <= room) return text;
    for (let n = text.length - 1; n > 2; n--) {
      const cut = `${text.slice(0, n)}…`;
      if (this.pen.measureText(cut).width <= room) return cut;
    }
    return "";
  }

  drawWords() {
    const { pen, colours, clip } = this;
    const [top, height] = ROWS.words;
    pen.textAlign = "left";
    clip.words.forEach(([text, start, end, keyword], k) => {
      const x = this.x(start);
      const room = Math.max(2, this.x(end) - x - 1);
      if (x + room < GUTTER || x > this.width) return;
      // Text may go on into the pause before the next word.
      const next = k + 1 < clip.words.length ? this.x(Math.max(end, clip.words[k + 1][1])) : this.width;
      pen.font = `${keyword ? "bold " : ""}11px system-ui, sans-serif`;
      pen.fillStyle = keyword ? colours["--keyword"] : colours["--grid"];
      pen.fillRect(x, keyword ? top : top + height - 2, room, keyword ? height : 2);
      pen.fillStyle = keyword ? colours["--paper"] : colours["--ink"];
      pen.fillText(this.fitText(text, (keyword ? room : next - x) - 3), x + 2, top + height / 2 - (keyword ? 0 : 1));
    });
  }

  drawPieces() {
    const { pen, colours, clip, trace } = this;
    const [top, height] = ROWS.pieces;
    pen.font = "11px system-ui, sans-serif";
    pen.textAlign = "left";
    trace.pieces.forEach(([start, end, kind, keyword, fallback], k) => {
      const x = this.x(start / clip.fps);
      const wide = this.x(end / clip.fps) - x;
      if (x + wide < GUTTER || x > this.width) return;
      pen.fillStyle = colours[k % 2 ? "--shade-2" : "--shade"];
      pen.fillRect(x, top, wide, height);
      if (fallback) this.hatch(x, top, wide, height);
      if (kind === "keyword") {
        pen.fillStyle = colours["--keyword"];
        pen.fillRect(x + Math.max(0, wide - 3), top, Math.min(3, wide), height);
      }
      const said = fallback ? `! ${fallback}` : kind === "keyword" ? keyword : kind;
      const text = this.fitText(said, wide - 7);
      if (!text) return;
      if (fallback) {
        pen.fillStyle = colours["--paper"];
        pen.fillRect(x + 2, top + 5, pen.measureText(text).width + 4, height - 10);
      }
      pen.fillStyle = fallback ? colours["--fallback"] : colours["--ink"];
      pen.fillText(text, x + 4, top + height / 2);
    });
  }

  hatch(x, y, wide, high) {
    const { pen, colours } = this;
    pen.save();
    pen.beginPath();
    pen.rect(x, y, wide, high);
    pen.clip();
    pen.strokeStyle = colours["--fallback"];
    pen.lineWidth = 1.5;
    pen.beginPath();
    for (let at = x - high - (x % 6); at < x + wide; at += 6) {
      pen.moveTo(at, y + high);
      pen.lineTo(at + high, y);
    }
    pen.stroke();
    pen.strokeRect(x + 0.75, y + 0.75, Math.max(0, wide - 1.5), high - 1.5);
    pen.restore();
  }

  drawJoins() {
    const { pen, colours, clip, trace } = this;
    const [top, height] = ROWS.joins;
    pen.fillStyle = colours["--grid"];
    pen.fillRect(GUTTER, top + height, this.width - GUTTER, 1);
    for (const [frame, distance, natural] of trace.joins) {
      const share = Math.min(1, distance / this.joinScale);
      const tall = natural ? 6 : Math.max(6, height * share);
      pen.fillStyle = natural ? colours["--natural"] : distanceColour(share);
      pen.fillRect(this.x(frame / clip.fps) - 1.5, top + height - tall, 3, tall);
    }
  }

  drawSource() {
    const { pen, clip, trace } = this;
    const [top, height] = ROWS.source;
    const most = this.mostSource();
    const dot = Math.max(1.6, (this.width - GUTTER) / (this.span * clip.fps) + 0.4);
    const first = Math.max(0, Math.floor(this.start * clip.fps));
    const last = Math.min(trace.source.length, Math.ceil((this.start + this.span) * clip.fps) + 1);
    for (let f = first; f < last; f++) {
      pen.fillStyle = REFERENCE_COLOURS[trace.reference[f] % REFERENCE_COLOURS.length];
      const y = top + 3 + (height - 8) * (1 - trace.source[f] / most);
      pen.fillRect(this.x((f + 0.5) / clip.fps) - dot / 2, y - 0.9, dot, 1.8);
    }
  }

  // The time range in which something is asked of the hands.
  drawWhen({ from, to }, top) {
    this.pen.fillStyle = this.colours["--shade-2"];
    this.pen.fillRect(this.x(from), top + 3, this.x(to) - this.x(from), CONTROL_ROW - 6);
  }

  // The bounds as broken lines where they hold, and over them what was achieved.
  drawDemand({ from, to, low, high, values }, top) {
    const { pen, colours, clip } = this;
    const [least, most] = this.controlRange(values, low, high);
    const y = (value) => top + 7 + (CONTROL_ROW - 14) * (1 - (value - least) / (most - least));
    pen.strokeStyle = colours["--fallback"];
    // Two whole pixels: a line between them would be pale.
    pen.lineWidth = 2;
    pen.setLineDash([5, 3]);
    for (const bound of [low, high]) {
      if (bound === null) continue;
      pen.beginPath();
      pen.moveTo(this.x(from), Math.round(y(bound)));
      pen.lineTo(this.x(to), Math.round(y(bound)));
      pen.stroke();
    }
    pen.setLineDash([]);
    pen.lineWidth = 1.5;
    pen.strokeStyle = colours["--accent"];
    pen.beginPath();
    const first = Math.max(0, Math.floor(this.start * clip.fps) - 1);
    const last = Math.min(values.length, Math.ceil((this.start + this.span) * clip.fps) + 2);
    for (let f = first; f < last; f++) pen.lineTo(this.x((f + 0.5) / clip.fps), y(values[f]));
    pen.stroke();
  }
}
