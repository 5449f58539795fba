"use strict";
/* Curves over time on plain canvases. All plots of a section share the span of time that they show. */

const MARGIN = { left: 66, right: 12, top: 26, bottom: 22 };
const $ = (id) => document.getElementById(id);

/** Numbers of {type, base64} as a typed array; 16-bit ones are low + step * number. */
function numbers(packed) {
  if (!packed) return null;
  const bytes = Uint8Array.from(atob(packed.base64), (c) => c.charCodeAt(0));
  if (packed.type === "float64") return new Float64Array(bytes.buffer);
  if (packed.type === "float32") return new Float32Array(bytes.buffer);
  if (packed.type === "uint8") return bytes;
  return Float32Array.from(new Uint16Array(bytes.buffer), (n) => packed.low + packed.step * n);
}

/** Component k of rows of m numbers. */
const column = (rows, m, k) => Float32Array.from({ length: rows.length / m }, (_, i) => rows[i * m + k]);

/** Steps of 1, 2 or 5 times a power of ten, about `count` of them between low and high. */
function ticks(low, high, count) {
  const raw = (high - low) / count, power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= raw * 0.999);
  const found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) found.push(k * step);
  return { found, step };
}

/** A number with as many digits as a step between ticks tells. */
function figure(value, step) {
  const size = Math.abs(value);
  if (size < 1e-9 * step) return "0";
  if (step < 1e-6 || size >= 1e6) {
    const digits = Math.max(0, Math.floor(Math.log10(size)) - Math.floor(Math.log10(step)));
    return value.toExponential(Math.min(digits, 6)).replace("e+", "e").replace("-", "\u2212");
  }
  const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  return value.toFixed(digits).replace("-", "\u2212");
}

/** 10 to the power of `value`, as a power where that is whole. */
function powerOfTen(value) {
  const whole = Math.round(value);
  if (Math.abs(value - whole) > 1e-6) return (10 ** value).toPrecision(2).replace("e+", "e").replace("-", "\u2212");
  if (whole >= -2 && whole <= 3) return String(Number((10 ** whole).toPrecision(1)));
  const raised = (digit) => "\u207b\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079"["-0123456789".indexOf(digit)];
  return "10" + [...String(whole)].map(raised).join("");
}

/** Index of the last of the increasing times that is not after t; 0 before them all. */
function indexAt(times, t) {
  let low = 0, high = times.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (times[middle] <= t) low = middle;
    else high = middle - 1;
  }
  return low;
}

/** The value of a curve at t, between samples on a straight line. */
function valueAt(times, values, t) {
  const k = indexAt(times, t);
  if (k + 1 >= times.length || t <= times[k]) return values[k];
  const s = (t - times[k]) / (times[k + 1] - times[k]);
  return values[k] + s * (values[k + 1] - values[k]);
}

class Plot {
  /* spec: {title, unit, scale: of such values in the run; what changes by less than its 1e-7 is drawn as constant,
   * across: unit of the horizontal axis, logarithmic: which axes are, "", "y" or "xy": numbers are decades there,
   * bounds: what the vertical axis shows at least, or null,
   * lines: [{name, color, t, y, exact: {t, y} or null}]}; seek(t), zoom(from, to): what to do. */
  constructor(host, spec, seek, zoom) {
    Object.assign(this, { across: "s", logarithmic: "", bounds: null }, spec, { seek, zoom });
    this.root = document.createElement("figure");
    this.back = this.root.appendChild(document.createElement("canvas"));
    this.front = this.root.appendChild(document.createElement("canvas"));
    this.front.setAttribute("role", "img");
    this.front.setAttribute("aria-label", `${spec.title} over ${this.across === "s" ? "time" : "frequency"}`);
    host.appendChild(this.root);
    this.front.addEventListener("pointerdown", (event) => this.press(event));
    this.front.addEventListener("dblclick", () => zoom(null, null));
  }

  /** Click: go to that time; drag: show that span of time only. */
  press(event) {
    const at = (e) => {
      const box = this.front.getBoundingClientRect();
      const s = (e.clientX - box.left - MARGIN.left) / (box.width - MARGIN.left - MARGIN.right);
      return this.from + Math.max(0, Math.min(1, s)) * (this.to - this.from);
    };
    const first = event.clientX, begun = at(event);
    const move = (e) => {
      if (Math.abs(e.clientX - first) > 4) this.chosen = [begun, at(e)];
      this.cursor(this.now);
    };
    const end = (e) => {
      this.front.removeEventListener("pointermove", move);
      const chosen = this.chosen;
      this.chosen = null;
      if (chosen && Math.abs(e.clientX - first) > 8) this.zoom(Math.min(...chosen), Math.max(...chosen));
      else this.seek(at(e));
    };
    this.front.setPointerCapture(event.pointerId);
    this.front.addEventListener("pointermove", move);
    this.front.addEventListener("pointerup", end, { once: true });
  }

  pen(canvas) {
    const ratio = window.devicePixelRatio || 1, box = this.root.getBoundingClientRect();
    [this.width, this.height] = [box.width, box.height];
    canvas.width = Math.round(box.width * ratio);
    canvas.height = Math.round(box.height * ratio);
    const pen = canvas.getContext("2d");
    pen.scale(ratio, ratio);
    pen.font = "12px system-ui, sans-serif";
    return pen;
  }

  x(t) {
    return MARGIN.left + ((t - this.from) / (this.to - this.from)) * (this.width - MARGIN.left - MARGIN.right);
  }

  y(v) {
    return MARGIN.top + ((this.high - v) / (this.high - this.low)) * (this.height - MARGIN.top - MARGIN.bottom);
  }

  /** Least and greatest value in view, with room about them. */
  range() {
    let [low, high] = this.bounds || [Infinity, -Infinity];
    const look = (t, y) => {
      const first = indexAt(t, this.from), last = Math.min(t.length - 1, indexAt(t, this.to) + 1);
      for (let k = first; k <= last; k++) {
        if (y[k] < low) low = y[k];
        if (y[k] > high) high = y[k];
      }
    };
    for (const line of this.lines) {
      look(line.t, line.y);
      if (line.exact) look(line.exact.t, line.exact.y);
    }
    if (!(high >= low)) [low, high] = [-1, 1];
    const room = high - low > 1e-7 * this.scale ? 0.06 * (high - low) : 0.1 * this.scale || 1;
    [this.low, this.high] = [low - room, high + room];
  }

  /** Where the lines of a grid are, and their numbers; whole decades on a logarithmic axis of several. */
  ticks(axis, low, high, count) {
    if (!this.logarithmic.includes(axis)) {
      const { found, step } = ticks(low, high, count);
      return { found, text: (v) => figure(v, step), zero: (v) => Math.abs(v) < 1e-9 * step };
    }
    const { found } = ticks(low, high, high - low < 2 ? count : Math.min(count, high - low));
    return { found, text: powerOfTen, zero: () => false };
  }

  draw(from, to, now) {
    [this.from, this.to] = [from, to];
    const pen = this.pen(this.back), { left, right, top, bottom } = MARGIN;
    this.range();
    const end = this.width - right, floor = this.height - bottom;
    pen.lineWidth = 1;
    pen.textBaseline = "middle";
    pen.textAlign = "right";
    const rows = this.ticks("y", this.low, this.high, (floor - top) / 34);
    for (const v of rows.found) {
      pen.strokeStyle = rows.zero(v) ? "#9aa3ad" : "#e6e9ed";
      pen.beginPath();
      pen.moveTo(left, this.y(v));
      pen.lineTo(end, this.y(v));
      pen.stroke();
      pen.fillStyle = "#55606b";
      pen.fillText(rows.text(v), left - 6, this.y(v));
    }
    pen.textBaseline = "alphabetic";
    pen.textAlign = "center";
    const columns = this.ticks("x", from, to, (end - left) / 80);
    for (const t of columns.found) {
      pen.strokeStyle = "#e6e9ed";
      pen.beginPath();
      pen.moveTo(this.x(t), top);
      pen.lineTo(this.x(t), floor);
      pen.stroke();
      pen.fillText(columns.text(t), this.x(t), this.height - 6);
    }
    pen.textAlign = "right";
    pen.fillText(this.across, left - 6, this.height - 6);
    pen.textAlign = "left";
    pen.fillStyle = "#1f2933";
    pen.font = "600 12px system-ui, sans-serif";
    pen.fillText(this.title + (this.unit ? ` [${this.unit}]` : ""), 8, 16);
    this.titled = 8 + pen.measureText(this.title + ` [${this.unit}]`).width;
    pen.save();
    pen.beginPath();
    pen.rect(left, top, end - left, floor - top);
    pen.clip();
    pen.lineJoin = "round";
    for (const line of this.lines) this.curve(pen, line.t, line.y, line.color, 1.6, []);
    for (const line of this.lines)
      if (line.exact) this.curve(pen, line.exact.t, line.exact.y, "#111", 1.3, [5, 5]);
    pen.restore();
    this.cursor(now);
  }

  curve(pen, t, y, color, width, dash) {
    const first = indexAt(t, this.from), last = Math.min(t.length - 1, indexAt(t, this.to) + 1);
    pen.beginPath();
    let down = false;
    for (let k = first; k <= last; k++) {
      if (!Number.isFinite(y[k])) down = false;
      else if (down) pen.lineTo(this.x(t[k]), this.y(y[k]));
      else {
        pen.moveTo(this.x(t[k]), this.y(y[k]));
        down = true;
      }
    }
    pen.strokeStyle = color;
    pen.lineWidth = width;
    pen.setLineDash(dash);
    pen.stroke();
    pen.setLineDash([]);
  }

  /** The line at the time shown, and the values there as the legend; now: null for names alone. */
  cursor(now) {
    this.now = now;
    const pen = this.pen(this.front), floor = this.height - MARGIN.bottom;
    if (this.chosen) {
      const [a, b] = this.chosen.map((t) => this.x(t));
      pen.fillStyle = "rgba(43,98,196,0.12)";
      pen.fillRect(Math.min(a, b), MARGIN.top, Math.abs(b - a), floor - MARGIN.top);
    }
    if (now !== null && now >= this.from && now <= this.to) {
      pen.strokeStyle = "#20262e";
      pen.lineWidth = 1;
      pen.beginPath();
      pen.moveTo(this.x(now), MARGIN.top);
      pen.lineTo(this.x(now), floor);
      pen.stroke();
    }
    const step = (this.high - this.low) / 1000;
    pen.textAlign = "right";
    pen.font = "12px system-ui, sans-serif";
    let right = this.width - MARGIN.right;
    const write = (text, color) => {
      if (right - pen.measureText(text).width < this.titled + 12) return;
      pen.fillStyle = color;
      pen.fillText(text, right, 16);
      right -= pen.measureText(text).width + 12;
    };
    const value = (v) => (this.logarithmic.includes("y") ? (10 ** v).toPrecision(3) : figure(v, step));
    for (const line of this.lines.slice().reverse())
      write(now === null ? line.name : `${line.name} ${value(valueAt(line.t, line.y, now))}`, line.color);
    if (this.lines.some((line) => line.exact)) write("- - closed form", "#111");
  }
}
