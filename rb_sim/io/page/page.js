"use strict";
/* The page: data, the picture at one time, and what the reader can turn, switch and drag. */

const D = JSON.parse(document.getElementById("data").textContent);
const times_ = numbers(D.t), first = times_[0], last = times_[times_.length - 1];
const N = D.bodies.length, position = numbers(D.position), orientation = numbers(D.orientation);
const exact = D.exact && {
  position: numbers(D.exact.position), orientation: numbers(D.exact.orientation),
  energy: numbers(D.exact.energy), reactions: D.exact.reactions.map(numbers),
};
const arrows = D.arrows.map((a) => ({ ...a, point: numbers(a.point), vector: numbers(a.vector), state: numbers(a.state) }));
const color = (hex) => [1, 3, 5].map((k) => parseInt(hex.slice(k, k + 2), 16));

/* ---- where everything is at a time */

function poseOf(body, t) {
  const k = indexAt(times_, t), next = Math.min(k + 1, times_.length - 1);
  const s = next > k ? Math.max(0, Math.min(1, (t - times_[k]) / (times_[next] - times_[k] || 1))) : 0;
  const i = k * N + body, j = next * N + body, p = [], q = [];
  for (let m = 0; m < 3; m++) p.push((1 - s) * position[3 * i + m] + s * position[3 * j + m]);
  let same = 0;
  for (let m = 0; m < 4; m++) same += orientation[4 * i + m] * orientation[4 * j + m];
  for (let m = 0; m < 4; m++)
    q.push((1 - s) * orientation[4 * i + m] + (same < 0 ? -s : s) * orientation[4 * j + m]);
  const size = Math.hypot(...q);
  return { position: p, orientation: q.map((c) => c / size) };
}

const REST = { position: [0, 0, 0], axes: [[1, 0, 0], [0, 1, 0], [0, 0, 1]] };

/** A point given on a body (from its centre of mass) or, on -1, in the world. */
const placed = (frames, on, p) => {
  const frame = on < 0 ? REST : frames[on];
  return add(frame.position, inWorld(frame.axes, p));
};

/** The solid of a description {kind, center, axis or axes, ...} in its frame. */
function solidOf(shape, frame, rgb) {
  const axes = shape.axes || (shape.axis ? axesAlong(shape.axis) : REST.axes);
  return {
    ...shape, color: rgb, center: add(frame.position, inWorld(frame.axes, shape.center)),
    axes: axes.map((axis) => inWorld(frame.axes, axis)),
  };
}

/* ---- what is drawn */

const canvas = $("scene"), camera = new Camera(D.view.center, D.view.size);
const walls = D.supports.planes.filter((plane) => plane.on < 0 && plane.thing);
camera.face(walls);
const state = { time: first, playing: false, speed: 1 };
const shown = {};
const GREY = [128, 136, 146];

function frame() {
  const ratio = window.devicePixelRatio || 1, box = canvas.getBoundingClientRect();
  canvas.width = Math.round(box.width * ratio);
  canvas.height = Math.round(box.height * ratio);
  const pen = canvas.getContext("2d");
  pen.scale(ratio, ratio);
  const sky = pen.createLinearGradient(0, 0, 0, box.height);
  sky.addColorStop(0, "#e9eef4");
  sky.addColorStop(1, "#fbfcfd");
  pen.fillStyle = sky;
  pen.fillRect(0, 0, box.width, box.height);
  camera.fit(box.width, box.height);
  const frames = D.bodies.map((_, i) => {
    const pose = poseOf(i, state.time);
    return { position: pose.position, axes: axesOf(...pose.orientation) };
  });
  const bodies = [];
  D.bodies.forEach((body, i) => {
    if (body.solid) bodies.push(solidOf(body.solid, frames[i], color(body.color)));
  });
  const fixed = D.supports.solids.map((s) => solidOf(s, s.on < 0 ? REST : frames[s.on], GREY));
  for (const plane of D.supports.planes) drawPlane(pen, plane, frames, bodies);
  for (const line of D.supports.lines) drawLine(pen, line.points.map((p) => placed(frames, line.on, p)), "#8a939e", 2, line.dash);
  if (shown.trace) drawTraces(pen, 1);
  const drawn = [...fixed, ...bodies].filter((s) => (s.box = bounds(s, camera)));
  for (const solid of inOrder(drawn, camera.eye)) drawSolid(pen, solid, camera);
  if (shown.trace) drawTraces(pen, 0.3);
  for (const link of D.supports.links) drawLink(pen, link, frames);
  for (const joint of D.supports.joints) drawDot(pen, placed(frames, joint.on, joint.point), "#39424e", 3.5);
  if (shown.axes) frames.forEach((f, i) => drawAxes(pen, f, D.bodies[i].reach));
  drawArrows(pen);
  if (shown.names) drawNames(pen, frames);
  drawCorner(pen, box.height);
}

function drawLine(pen, points, style, width, dash) {
  pen.beginPath();
  let down = false;
  for (const p of points) {
    const q = camera.project(p);
    if (!q) down = false;
    else if (down) pen.lineTo(q[0], q[1]);
    else {
      pen.moveTo(q[0], q[1]);
      down = true;
    }
  }
  pen.strokeStyle = style;
  pen.lineWidth = width;
  pen.lineCap = "round";
  pen.setLineDash(dash ? [9, 4, 2, 4] : []);
  pen.stroke();
  pen.setLineDash([]);
}

function drawDot(pen, p, style, radius) {
  const q = camera.project(p);
  if (!q) return;
  pen.beginPath();
  pen.arc(q[0], q[1], radius, 0, 2 * Math.PI);
  pen.fillStyle = style;
  pen.fill();
  pen.strokeStyle = "#fff";
  pen.lineWidth = 1;
  pen.stroke();
}

/** A grid that fades outwards, and the shadows of the bodies on it; it hides nothing. */
function drawPlane(pen, plane, frames, bodies) {
  const rotation = plane.spin ? axesAround(plane.spin, state.time) : REST.axes;
  const around = (p) => (plane.spin ? add(plane.about, inWorld(rotation, sub(p, plane.about))) : p);
  let shift = [0, 0, 0];
  if (plane.shaken) {
    const { amplitude, frequency, phase } = plane.shaken;
    shift = times(Math.sin(frequency * state.time + phase), amplitude);
  }
  const o = add(around(placed(frames, plane.on, plane.point)), shift);
  const axes = plane.on < 0 ? REST.axes : frames[plane.on].axes;
  const n = inWorld(rotation, inWorld(axes, plane.normal));
  const u = inWorld(rotation, inWorld(axes, plane.along)), v = cross(n, u);
  const size = plane.size, step = plane.step, count = Math.round(size / step);
  const at = (x, y) => add(o, add(times(x, u), times(y, v)));
  const sees = dot(n, sub(camera.eye, o)) > 0;
  const strength = plane.thing ? 0.5 : 0.24;
  const others = plane.on < 0 ? walls.filter((wall) => wall !== plane && !wall.spin && !wall.shaken) : [];
  if (plane.thing) {
    const rim = Array.from({ length: 48 }, (_, k) => at(size * Math.cos((Math.PI * k) / 24), size * Math.sin((Math.PI * k) / 24)));
    const seen = cut(rim, others).map((p) => camera.project(p));
    if (seen.length > 2 && seen.every(Boolean)) {
      polygon(pen, seen);
      pen.fillStyle = sees ? "rgba(120,132,146,0.10)" : "rgba(120,132,146,0.04)";
      pen.fill();
    }
  }
  if (sees && n[2] > 0.5) {
    pen.beginPath();
    for (const solid of bodies) {
      if (dot(sub(solid.center, o), n) < 0 || solid.ghost) continue;
      const outline = shadowOf(solid, o, n, [u, v]).filter(([x, y]) => Math.hypot(x, y) < 1.05 * size);
      const seen = cut(outline.map(([x, y]) => at(x, y)), others).map((p) => camera.project(p));
      if (seen.length < 3 || !seen.every(Boolean)) continue;
      seen.forEach((p, k) => (k ? pen.lineTo(p[0], p[1]) : pen.moveTo(p[0], p[1])));
      pen.closePath();
    }
    pen.fillStyle = "rgba(30,40,55,0.15)";
    pen.fill();
  }
  const BANDS = 5, bands = Array.from({ length: BANDS }, () => []);
  for (let k = -count; k <= count; k++)
    for (const swap of [false, true]) {
      const x = k * step, half = Math.sqrt(Math.max(0, size * size - x * x)), pieces = 14;
      for (let m = 0; m < pieces; m++) {
        const [a, b] = [m, m + 1].map((j) => half * ((2 * j) / pieces - 1));
        const far = Math.hypot(x, (a + b) / 2) / size;
        const ends = cut([a, b].map((y) => (swap ? at(y, x) : at(x, y))), others).map((p) => camera.project(p));
        if (ends[0] && ends[1]) bands[Math.min(BANDS - 1, Math.floor(far * BANDS))].push(ends);
      }
    }
  pen.lineWidth = 1;
  bands.forEach((lines, k) => {
    pen.beginPath();
    for (const [a, b] of lines) {
      pen.moveTo(a[0], a[1]);
      pen.lineTo(b[0], b[1]);
    }
    pen.strokeStyle = `rgba(95,108,124,${strength * (1 - k / BANDS)})`;
    pen.stroke();
  });
}

/** The part of a polygon, or of a piece of a line, that lies before all of the planes. */
function cut(points, planes) {
  for (const plane of planes) {
    const high = (p) => dot(plane.normal, sub(p, plane.point)) + 1e-6 * D.view.size;
    const kept = [];
    points.forEach((p, k) => {
      const before = points[(k + points.length - 1) % points.length], [a, b] = [high(before), high(p)];
      if (a * b < 0 && (k || points.length > 2)) kept.push(add(before, times(a / (a - b), sub(p, before))));
      if (b >= 0) kept.push(p);
    });
    points = kept;
  }
  return points;
}

function axesAround(spin, t) {
  const rate = norm(spin), half = (rate * t) / 2, s = rate ? Math.sin(half) / rate : 0;
  return axesOf(s * spin[0], s * spin[1], s * spin[2], Math.cos(half));
}

/** A rod, a string, or a spring as a zigzag between two points. */
function drawLink(pen, link, frames) {
  const a = placed(frames, link.from.on, link.from.point), b = placed(frames, link.to.on, link.to.point);
  const points = [a];
  if (link.kind === "spring") {
    const side = times(0.022 * D.view.size, unit(cross(sub(b, a), camera.forward)));
    for (let k = 1; k < 16; k++) {
      const p = add(a, times(0.15 + (0.7 * (k - 1)) / 14, sub(b, a)));
      points.push(k % 2 ? add(p, side) : sub(p, side));
    }
  }
  points.push(b);
  drawLine(pen, points, "#39424e", link.kind === "rod" ? 3 : 1.6, false);
  drawDot(pen, a, "#39424e", 3);
  drawDot(pen, b, "#39424e", 3);
}

function drawTraces(pen, alpha) {
  const end = indexAt(times_, state.time);
  pen.globalAlpha = alpha;
  D.bodies.forEach((body, i) => {
    const points = [];
    for (let k = 0; k <= end; k++) points.push(Array.from(position.subarray(3 * (k * N + i), 3 * (k * N + i) + 3)));
    points.push(poseOf(i, state.time).position);
    drawLine(pen, points, N > 1 ? body.color : D.colors.trace, 2, false);
  });
  pen.globalAlpha = 1;
}

function drawAxes(pen, at, length) {
  const start = camera.project(at.position);
  at.axes.forEach((axis, k) => {
    const end = camera.project(add(at.position, times(length, axis)));
    if (start && end) arrow(pen, start, end, D.colors.axes[k], 2.4, 1);
  });
}

/** An arrow between two pixels; heads: 1, or 2 for a torque. */
function arrow(pen, a, b, style, width, heads) {
  const [dx, dy] = [b[0] - a[0], b[1] - a[1]], length = Math.hypot(dx, dy);
  if (length < 1) return;
  const [x, y] = [dx / length, dy / length], head = Math.min(4.2 * width, 0.7 * length);
  for (const [extra, paint] of [[2.4, "rgba(255,255,255,0.85)"], [0, style]]) {
    pen.strokeStyle = pen.fillStyle = paint;
    pen.lineWidth = width + extra;
    pen.lineCap = "butt";
    pen.beginPath();
    pen.moveTo(a[0], a[1]);
    pen.lineTo(b[0] - 0.8 * head * x, b[1] - 0.8 * head * y);
    pen.stroke();
    for (let h = 0; h < heads; h++) {
      const [cx, cy] = [b[0] - 0.75 * h * head * x, b[1] - 0.75 * h * head * y];
      polygon(pen, [[cx, cy], [cx - head * x + 0.42 * head * y, cy - head * y - 0.42 * head * x],
        [cx - head * x - 0.42 * head * y, cy - head * y + 0.42 * head * x]]);
      pen.lineWidth = extra;
      if (extra) pen.stroke();
      pen.fill();
    }
  }
}

/** Both ends of an arrow at sample k. */
function endsOf(one, k) {
  const [p, f] = [one.point, one.vector].map((rows) => Array.from(rows.subarray(3 * k, 3 * k + 3)));
  return [p, add(p, times(1 / D.groups[one.group].per, f))];
}

function drawArrows(pen) {
  const k = indexAt(times_, state.time);
  for (const one of arrows) {
    const group = D.groups[one.group];
    if (!shown[one.group]) continue;
    const [p, tip] = endsOf(one, k);
    if (one.state && one.state[k]) drawDot(pen, p, D.colors.contact[one.state[k]], 4.5);
    if (!(norm(sub(tip, p)) > 1e-9)) continue;
    const from = camera.project(p), to = camera.project(tip);
    if (from && to) arrow(pen, from, to, group.color, 3, group.heads);
  }
}

/** Start so far away that 97 % of the arrows shown at the start end within the picture, over the whole run. */
function makeRoom() {
  const { width, height } = canvas.getBoundingClientRect(), stride = Math.ceil(times_.length / 200), tips = [];
  for (const one of arrows.filter((arrow) => D.groups[arrow.group].on))
    for (let k = 0; k < times_.length; k += stride) tips.push(endsOf(one, k)[1]);
  const inside = (p) => p && p[0] > 0 && p[0] < width && p[1] > 0 && p[1] < height;
  for (let tries = 0; tries < 12; tries++) {
    camera.fit(width, height);
    if (tips.filter((tip) => inside(camera.project(tip))).length >= 0.97 * tips.length) return;
    camera.home.distance *= 1.06;
    camera.reset();
  }
}

function drawNames(pen, frames) {
  pen.font = "13px system-ui, sans-serif";
  pen.textAlign = "center";
  D.bodies.forEach((body, i) => {
    const p = camera.project(frames[i].position);
    if (!p) return;
    const y = p[1] - 8 - (0.55 * camera.focal * body.reach) / camera.depth(frames[i].position);
    pen.lineWidth = 3.5;
    pen.strokeStyle = "rgba(255,255,255,0.9)";
    pen.strokeText(body.name, p[0], y);
    pen.fillStyle = "#1f2933";
    pen.fillText(body.name, p[0], y);
  });
}

/** The world's axes in the corner. */
function drawCorner(pen, height) {
  const at = [46, height - 44];
  pen.font = "600 13px system-ui, sans-serif";
  pen.textAlign = "center";
  const axes = REST.axes.map((axis, k) => ({ k, axis, deep: dot(axis, camera.forward) }));
  for (const { k, axis } of axes.sort((a, b) => b.deep - a.deep)) {
    const [x, y] = [dot(axis, camera.right), -dot(axis, camera.up)];
    arrow(pen, at, [at[0] + 30 * x, at[1] + 30 * y], D.colors.axes[k], 2, 1);
    pen.fillStyle = D.colors.axes[k];
    pen.fillText("xyz"[k], at[0] + 40 * x, at[1] + 40 * y + 4);
  }
}

/* ---- curves */

/** Angles in degrees, turns counted, of rows of quaternions [x, y, z, w] of one body. */
const ANGLES = {
  "roll, pitch, yaw": {
    names: ["roll \u03c6", "pitch \u03b8", "yaw \u03c8"],
    of: (x, y, z, w) => [
      Math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
      Math.asin(Math.max(-1, Math.min(1, 2 * (w * y - z * x)))),
      Math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
    ],
    other: ([roll, pitch, yaw]) => [roll + Math.PI, Math.PI - pitch, yaw + Math.PI],
  },
  "precession, nutation, spin (z-x-z)": {
    names: ["precession \u03c6", "nutation \u03b8", "spin \u03c8"],
    of: (x, y, z, w) => [
      Math.atan2(2 * (x * z + w * y), -2 * (y * z - w * x)),
      Math.acos(Math.max(-1, Math.min(1, 1 - 2 * (x * x + y * y)))),
      Math.atan2(2 * (x * z - w * y), 2 * (y * z + w * x)),
    ],
    other: ([precession, nutation, spin]) => [precession + Math.PI, -nutation, spin + Math.PI],
  },
};

/** Of the two triples of an attitude each sample has the one nearer to the sample before, as in plots.png. */
function anglesOf(rows, body, kind) {
  const n = rows.length / (4 * N), found = [0, 1, 2].map(() => new Float32Array(n));
  let before = null;
  for (let k = 0; k < n; k++) {
    let now = kind.of(...rows.subarray(4 * (k * N + body), 4 * (k * N + body) + 4));
    if (before) {
      const near = (angles) => angles.map((angle, m) => angle - 2 * Math.PI * Math.round((angle - before[m]) / (2 * Math.PI)));
      const apart = (angles) => angles.reduce((sum, angle, m) => sum + Math.abs(angle - before[m]), 0);
      const [same, other] = [near(now), near(kind.other(now))];
      now = apart(other) < apart(same) ? other : same;
    }
    now.forEach((angle, m) => { found[m][k] = (angle * 180) / Math.PI; });
    before = now;
  }
  return found;
}

const bodyColumn = (rows, body, k) => Float32Array.from({ length: rows.length / (3 * N) }, (_, i) => rows[3 * (i * N + body) + k]);

let plots = [];
const span = { from: first, to: last > first ? last : first + 1 };
const chosen = { body: 0, angles: Object.keys(ANGLES)[0], reaction: D.strongest ?? 0 };

function xyz(rows, t, names, exactRows) {
  return names.map((name, k) => ({
    name, color: D.colors.axes[k], t, y: column(rows, 3, k),
    exact: exactRows && { t: times_, y: column(exactRows, 3, k) },
  }));
}

function specs() {
  const { body, reaction } = chosen, name = D.bodies[body].name, kind = ANGLES[chosen.angles];
  const angles = anglesOf(orientation, body, kind), lawful = exact && anglesOf(exact.orientation, body, kind);
  const found = [
    {
      title: `position of ${name}, ${D.point}`, unit: "m", scale: D.view.size,
      lines: ["x", "y", "z"].map((axis, k) => ({
        name: axis, color: D.colors.axes[k], t: times_, y: bodyColumn(position, body, k),
        exact: exact && { t: times_, y: bodyColumn(exact.position, body, k) },
      })),
    },
    {
      title: `angles of ${name}`, unit: "\u00b0", scale: 90,
      lines: kind.names.map((axis, k) => ({
        name: axis, color: D.colors.axes[k], t: times_, y: angles[k], exact: exact && { t: times_, y: lawful[k] },
      })),
    },
  ];
  {
    const t = numbers(D.curves.t), energy = numbers(D.curves.energy), pick = D.reactions[reaction];
    if (energy) found.push({
      title: "energy", unit: "J", scale: D.curves.scale.energy,
      lines: ["kinetic", "potential", "total"].map((part, k) => ({
        name: part, color: D.colors.energy[k], t, y: column(energy, 3, k),
        exact: exact && { t: times_, y: column(exact.energy, 3, k) },
      })),
    });
    if (pick) {
      const ours = exact ? exact.reactions : [];
      found.push({
        title: `${pick.name}: force on ${pick.body}`, unit: "N", scale: D.curves.scale.force,
        lines: xyz(numbers(pick.force), t, ["Fx", "Fy", "Fz"], ours[2 * reaction]),
      });
      if (pick.torque)
        found.push({
          title: `${pick.name}: torque about ${pick.about}`, unit: "N m", scale: D.curves.scale.torque,
          lines: xyz(numbers(pick.torque), t, ["Mx", "My", "Mz"], ours[2 * reaction + 1]),
        });
    }
  }
  return found;
}

function zoom(from, to) {
  [span.from, span.to] = from === null ? [first, last > first ? last : first + 1] : [from, to];
  for (const plot of plots) plot.draw(span.from, span.to, state.time);
}

/** Plots of what changes or is not zero, and the names of the others. */
function remake() {
  $("plots").replaceChildren();
  const none = (values, scale) => values.every((value) => Math.abs(value) <= 1e-9 * scale);
  const zero = ({ lines, scale }) => lines.every((l) => none(l.y, scale) && (!l.exact || none(l.exact.y, scale)));
  const all = specs(), absent = all.filter(zero).map((spec) => spec.title);
  plots = all.filter((spec) => !zero(spec)).map((spec) => new Plot($("plots"), spec, seek, zoom));
  if (absent.length)
    $("plots").appendChild(document.createElement("p")).textContent = `zero throughout: ${absent.join("; ")}`;
  zoom(span.from, span.to);
}

/* ---- what the reader does */

const seconds = (t) => figure(t, Math.max((last - first) / 2000, 1e-9));

function seek(t) {
  const before = poseOf(chosen.body, state.time).position;
  state.time = Math.max(first, Math.min(last, t));
  if (shown.follow) camera.target = add(camera.target, sub(poseOf(chosen.body, state.time).position, before));
  $("slider").value = state.time;
  $("clock").textContent = `t = ${seconds(state.time)} s`;
  const past = D.events.filter(([when]) => when <= state.time + 1e-12);
  $("event").textContent = past.length ? "last event: " + past[past.length - 1][1] : "";
  frame();
  for (const plot of plots) plot.cursor(state.time);
}

function play(on) {
  state.playing = on;
  $("play").innerHTML = on ? "&#10074;&#10074;" : "&#9654;";
  if (!on) return;
  if (state.time >= last) state.time = first;
  let before = performance.now();
  const tick = (now) => {
    if (!state.playing) return;
    const t = state.time + (state.speed * (now - before)) / 1000;
    before = now;
    seek(t);
    if (t >= last) play(false);
    else requestAnimationFrame(tick);
  };
  requestAnimationFrame(tick);
}

function select(label, options, value, change) {
  const host = $("chosen").appendChild(document.createElement("label"));
  host.append(label + " ");
  const list = host.appendChild(document.createElement("select"));
  options.forEach((text, k) => list.append(new Option(text, k)));
  list.value = value;
  list.addEventListener("change", () => change(Number(list.value)));
}

function checkbox(key, label, on) {
  shown[key] = on;
  const host = $("switches").appendChild(document.createElement("label"));
  const input = host.appendChild(document.createElement("input"));
  input.type = "checkbox";
  input.checked = on;
  host.append(" " + label);
  input.addEventListener("change", () => {
    shown[key] = input.checked;
    if (key === "follow" && input.checked) camera.target = poseOf(chosen.body, state.time).position;
    legend();
    frame();
  });
}

function legend() {
  const host = $("legend");
  host.replaceChildren();
  const row = (style, text, dotted) => {
    const line = host.appendChild(document.createElement("div")), mark = line.appendChild(document.createElement("i"));
    if (dotted) [mark.className, mark.style.background] = ["dot", style];
    else mark.style.borderColor = style;
    line.append(text);
  };
  for (const [key, group] of Object.entries(D.groups))
    if (shown[key]) row(group.color, `${group.name}: an arrow of ${group.length} m is ${group.value} ${group.unit}`);
  if (arrows.some((a) => a.state && shown[a.group])) {
    row(D.colors.contact[1], "contact slips", true);
    row(D.colors.contact[2], "contact sticks or rolls", true);
  }
  for (const text of D.legend) {
    const line = host.appendChild(document.createElement("div"));
    line.append(text);
  }
}

function turnByHand() {
  const hands = new Map();
  const spread = () => {
    const [a, b] = [...hands.values()];
    return { gap: Math.hypot(a.x - b.x, a.y - b.y), x: (a.x + b.x) / 2, y: (a.y + b.y) / 2 };
  };
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    hands.set(event.pointerId, { x: event.clientX, y: event.clientY });
  });
  canvas.addEventListener("pointermove", (event) => {
    const hand = hands.get(event.pointerId);
    if (!hand) return;
    const before = hands.size === 2 ? spread() : null;
    const [dx, dy] = [event.clientX - hand.x, event.clientY - hand.y];
    [hand.x, hand.y] = [event.clientX, event.clientY];
    if (before) {
      const after = spread();
      camera.zoom(before.gap / after.gap);
      camera.shift(after.x - before.x, after.y - before.y);
    } else if (event.shiftKey || event.buttons & 6) camera.shift(dx, dy);
    else camera.turn(dx, dy);
    frame();
  });
  for (const kind of ["pointerup", "pointercancel"])
    canvas.addEventListener(kind, (event) => hands.delete(event.pointerId));
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    camera.zoom(Math.exp(0.0012 * event.deltaY * (event.deltaMode ? 30 : 1)));
    frame();
  }, { passive: false });
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("dblclick", () => {
    camera.reset();
    frame();
  });
}

/** A stroke on the slider for each event. */
function marks() {
  const board = $("marks"), ratio = window.devicePixelRatio || 1, box = board.getBoundingClientRect();
  board.width = box.width * ratio;
  board.height = box.height * ratio;
  const pen = board.getContext("2d");
  pen.scale(ratio, ratio);
  pen.fillStyle = D.colors.event;
  const KNOB = 8; // the slider's knob keeps within its track
  for (const [when] of D.events)
    pen.fillRect(KNOB + ((when - first) / (last - first || 1)) * (box.width - 2 * KNOB) - 0.75, 2, 1.5, 9);
}

const SPEEDS = [0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 1000];

function begin() {
  document.title = D.title;
  $("name").textContent = D.title;
  $("description").textContent = D.description;
  for (const text of D.warnings) $("warnings").appendChild(document.createElement("p")).textContent = text;
  for (const pair of D.facts) {
    const row = $("facts").insertRow();
    for (const text of pair) row.insertCell().textContent = text;
  }
  const length = last - first, wanted = length > 3 && length < 40 ? 1 : length / 10;
  state.speed = SPEEDS.reduce((a, b) => (Math.abs(Math.log(b / wanted)) < Math.abs(Math.log(a / wanted)) ? b : a));
  for (const speed of SPEEDS) $("speed").append(new Option(`${speed} \u00d7`, speed));
  $("speed").value = state.speed;
  $("speed").addEventListener("change", () => (state.speed = Number($("speed").value)));
  [$("slider").min, $("slider").max] = [first, last];
  $("slider").addEventListener("input", () => seek(Number($("slider").value)));
  $("play").addEventListener("click", () => play(!state.playing));
  for (const [key, group] of Object.entries(D.groups)) checkbox(key, group.name, group.on);
  checkbox("trace", `trace of the ${D.point}`, D.trace);
  checkbox("axes", "body axes", D.axes);
  checkbox("names", "names", D.names);
  checkbox("follow", N > 1 ? "camera follows the body chosen below" : "camera follows the body", false);
  if (N > 1) select("body", D.bodies.map((b) => b.name), 0, (k) => ((chosen.body = k), remake()));
  select("angles", Object.keys(ANGLES), 0, (k) => ((chosen.angles = Object.keys(ANGLES)[k]), remake()));
  if (D.reactions.length > 1)
    select("reaction", D.reactions.map((r) => r.name), D.strongest, (k) => ((chosen.reaction = k), remake()));
  document.addEventListener("keydown", (event) => {
    if (["SELECT", "INPUT"].includes(event.target.tagName) && event.key !== " ") return;
    const k = indexAt(times_, state.time);
    if (event.key === " ") play(!state.playing);
    else if (event.key === "ArrowRight") seek(times_[Math.min(k + 1, times_.length - 1)]);
    else if (event.key === "ArrowLeft") seek(times_[state.time > times_[k] ? k : Math.max(0, k - 1)]);
    else return;
    event.preventDefault();
  });
  $("event").hidden = !D.events.length;
  turnByHand();
  makeRoom();
  legend();
  remake();
  marks();
  seek(first);
  window.addEventListener("resize", () => {
    frame();
    marks();
    zoom(span.from, span.to);
  });
}

begin();

/** For tests and for the console of the browser. */
window.rb_sim = {
  state, camera, seek, play, shown,
  bodies: D.bodies.map((b) => b.name),
  poseOf: (name) => poseOf(D.bodies.findIndex((b) => b.name === name), state.time),
  pixelOf: (name) => camera.project(window.rb_sim.poseOf(name).position),
};
