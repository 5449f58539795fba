"use strict";
/* Convex solids on a plain 2D canvas, seen in perspective; no WebGL.
 *
 * Bodies are convex, so within one of them it is enough to leave out the faces that look away. Two
 * bodies are ordered by a plane that separates them: the one on the eye's side is drawn later.
 * A solid: {kind: "ball" | "box" | "ellipsoid" | "cylinder" | "cone", half or radius and length, ...,
 * center: p, axes: [x, y, z] (world), color: [r, g, b]}.
 */

const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const times = (s, a) => [s * a[0], s * a[1], s * a[2]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) =>
  [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const norm = (a) => Math.sqrt(dot(a, a));
const unit = (a) => times(1 / (norm(a) || 1), a);
const perpendicular = (n) =>
  unit(cross(n, Math.abs(n[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0]));

/** Columns of the rotation matrix of a quaternion [x, y, z, w]: the body's axes in the world. */
function axesOf(x, y, z, w) {
  const s = 2 / (x * x + y * y + z * z + w * w);
  return [
    [1 - s * (y * y + z * z), s * (x * y + w * z), s * (x * z - w * y)],
    [s * (x * y - w * z), 1 - s * (x * x + z * z), s * (y * z + w * x)],
    [s * (x * z + w * y), s * (y * z - w * x), 1 - s * (x * x + y * y)],
  ];
}

const inWorld = (axes, p) =>
  add(times(p[0], axes[0]), add(times(p[1], axes[1]), times(p[2], axes[2])));

/** Axes of a solid of revolution whose own z points along `axis`. */
function axesAlong(axis) {
  const x = perpendicular(axis);
  return [x, cross(axis, x), axis];
}

/* Meshes in the solid's own axes: {points, faces: [{at: indices, normal, light}]}. `light` marks the
 * quarters that are drawn lighter, which show how a round body turns. */

const meshes = new Map();

function meshOf(solid) {
  const key = solid.kind + ":" + (solid.half || [solid.radius, solid.length]).join(",");
  if (!meshes.has(key)) meshes.set(key, closed(BUILD[solid.kind](solid)));
  return meshes.get(key);
}

/** Outward normals of the faces, each by its first three corners. */
function closed({ points, faces }) {
  for (const face of faces) {
    const [a, b, c] = face.at.map((i) => points[i]);
    face.normal = unit(cross(sub(b, a), sub(c, a)));
    if (dot(face.normal, a) < 0) face.normal = times(-1, face.normal);
  }
  return { points, faces };
}

const SIDES = 40;

const BUILD = {
  box({ half: [a, b, c] }) {
    const points = [];
    for (const x of [-a, a]) for (const y of [-b, b]) for (const z of [-c, c]) points.push([x, y, z]);
    const faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]];
    return { points, faces: faces.map((at) => ({ at, edged: true })) };
  },
  cylinder({ radius, length }) {
    const points = [], faces = [], n = radius < 0.15 * length ? 16 : SIDES, h = length / 2;
    for (let k = 0; k < n; k++) {
      const x = radius * Math.cos((2 * Math.PI * k) / n), y = radius * Math.sin((2 * Math.PI * k) / n);
      points.push([x, y, -h], [x, y, h]);
    }
    points.push([0, 0, -h], [0, 0, h]);
    for (let k = 0; k < n; k++) {
      const i = 2 * k, j = 2 * ((k + 1) % n);
      faces.push({ at: [i, j, j + 1, i + 1], light: Math.floor((4 * k) / n) % 2 === 0 });
    }
    for (const up of [0, 1])
      for (let q = 0; q < 4; q++) {
        const at = [2 * n + up];
        for (let k = (q * n) / 4; k <= ((q + 1) * n) / 4; k++) at.push(2 * (k % n) + up);
        faces.push({ at, light: q % 2 === 0 });
      }
    return { points, faces };
  },
  ellipsoid({ half: [a, b, c] }) {
    const points = [], faces = [], rings = 16, n = 32;
    for (let i = 0; i <= rings; i++)
      for (let k = 0; k < n; k++) {
        const u = (Math.PI * i) / rings, v = (2 * Math.PI * k) / n;
        points.push([a * Math.sin(u) * Math.cos(v), b * Math.sin(u) * Math.sin(v), c * Math.cos(u)]);
      }
    for (let i = 0; i < rings; i++)
      for (let k = 0; k < n; k++) {
        const p = i * n + k, q = i * n + ((k + 1) % n);
        const at = i === 0 ? [p, p + n, q + n] : [p, p + n, q + n, q];
        faces.push({ at, light: (Math.floor((4 * k) / n) + (2 * i < rings ? 0 : 1)) % 2 === 0 });
      }
    return { points, faces };
  },
  cone({ radius, length }) {
    /* tip at +z length / 2 */
    const points = [[0, 0, length / 2]], faces = [], base = [];
    for (let k = 0; k < 24; k++) {
      const a = (2 * Math.PI * k) / 24;
      points.push([radius * Math.cos(a), radius * Math.sin(a), -length / 2]);
      base.push(k + 1);
      faces.push({ at: [0, k + 1, ((k + 1) % 24) + 1] });
    }
    faces.push({ at: base });
    return { points, faces };
  },
};

/** How far the solid reaches from its centre along the unit vector d. */
function reach(solid, d) {
  const [x, y, z] = solid.axes.map((axis) => dot(axis, d));
  switch (solid.kind) {
    case "ball":
      return solid.radius;
    case "box": {
      const h = solid.half;
      return Math.abs(x) * h[0] + Math.abs(y) * h[1] + Math.abs(z) * h[2];
    }
    case "ellipsoid": {
      const h = solid.half;
      return Math.hypot(x * h[0], y * h[1], z * h[2]);
    }
    case "cone": {
      const across = solid.radius * Math.sqrt(Math.max(0, 1 - z * z));
      return Math.max((z * solid.length) / 2, across - (z * solid.length) / 2);
    }
    default:
      return (Math.abs(z) * solid.length) / 2 + solid.radius * Math.sqrt(Math.max(0, 1 - z * z));
  }
}

/** Whether solid b is to be drawn after a: the eye is on b's side of the plane that parts them. */
function isBehind(a, b, eye) {
  const between = sub(b.center, a.center), line = unit(between);
  let best = { gap: -Infinity };
  const look = (axis) => {
    const size = norm(axis);
    if (size < 1e-6) return;
    let d = times(1 / size, axis);
    if (dot(d, between) < 0) d = times(-1, d);
    const ra = reach(a, d), gap = dot(between, d) - ra - reach(b, times(-1, d));
    if (gap > best.gap) best = { gap, d, at: ra + gap / 2 };
  };
  look(line);
  if (a.kind !== "ball" || b.kind !== "ball") {
    const own = (s) => (s.kind === "ball" ? [] : s.axes);
    for (const axis of own(a)) look(axis);
    for (const axis of own(b)) look(axis);
    for (const p of own(a)) {
      look(sub(between, times(dot(between, p), p))); // across a long axis
      for (const q of own(b)) look(cross(p, q));
    }
    for (const q of own(b)) look(sub(between, times(dot(between, q), q)));
  }
  return dot(sub(eye, a.center), best.d) > best.at;
}

/** The solids from the hindmost to the foremost. Each has `box`, its bounds on the screen. */
function inOrder(solids, eye) {
  const far = solids.map((s) => norm(sub(s.center, eye)));
  const rows = solids.map((_, i) => i).sort((i, j) => far[j] - far[i]);
  const behind = solids.map(() => []);
  for (let m = 0; m < rows.length; m++)
    for (let k = m + 1; k < rows.length; k++) {
      const i = rows[m], j = rows[k], p = solids[i].box, q = solids[j].box;
      if (p[0] > q[2] || q[0] > p[2] || p[1] > q[3] || q[1] > p[3]) continue;
      if (isBehind(solids[i], solids[j], eye)) behind[j].push(i);
      else behind[i].push(j);
    }
  const done = new Uint8Array(solids.length), order = [];
  const visit = (i) => {
    if (done[i]) return;
    done[i] = 1; // before its own: a ring of solids that hide each other is cut somewhere
    for (const j of behind[i]) visit(j);
    order.push(solids[i]);
  };
  for (const i of rows) visit(i);
  return order;
}

/* The eye: it looks at `target` from `distance` away, z up. */

class Camera {
  constructor(center, size) {
    this.home = { target: center.slice(), yaw: -0.98, pitch: 0.36, distance: 1.35 * size };
    this.reset();
  }

  reset() {
    Object.assign(this, this.home, { target: this.home.target.slice() });
  }

  /** Start on the side from which the most of these planes {point, normal} are seen. */
  face(planes) {
    const seen = (yaw) => planes.filter(({ point, normal }) => {
      this.yaw = yaw;
      this.fit(100, 100);
      return dot(normal, sub(this.eye, point)) > 0;
    }).length;
    const yaws = [-0.98, -2.16, 0.98, 2.16], counts = yaws.map(seen);
    this.home.yaw = yaws[counts.indexOf(Math.max(...counts))];
    this.reset();
  }

  /** Prepare for a canvas of this size in pixels. */
  fit(width, height) {
    const [cy, sy] = [Math.cos(this.yaw), Math.sin(this.yaw)];
    const [cp, sp] = [Math.cos(this.pitch), Math.sin(this.pitch)];
    this.forward = [-cp * cy, -cp * sy, -sp];
    this.right = [-sy, cy, 0];
    this.up = cross(this.right, this.forward);
    this.eye = sub(this.target, times(this.distance, this.forward));
    this.middle = [width / 2, height / 2];
    this.focal = 1.55 * Math.min(height, 0.8 * width);
    this.near = 0.01 * this.distance;
  }

  depth(p) {
    return dot(sub(p, this.eye), this.forward);
  }

  /** Pixels; null behind the eye. */
  project(p) {
    const r = sub(p, this.eye), d = dot(r, this.forward);
    if (d < this.near) return null;
    const s = this.focal / d;
    return [this.middle[0] + s * dot(r, this.right), this.middle[1] - s * dot(r, this.up)];
  }

  turn(dx, dy) {
    this.yaw -= 0.008 * dx;
    this.pitch = Math.max(-1.55, Math.min(1.55, this.pitch + 0.008 * dy));
  }

  shift(dx, dy) {
    const s = this.distance / this.focal;
    this.target = add(this.target, add(times(-dx * s, this.right), times(dy * s, this.up)));
  }

  zoom(factor) {
    const d = this.distance * factor, home = this.home.distance;
    this.distance = Math.max(home / 500, Math.min(20 * home, d));
  }
}

const LIGHT = unit([0.35, -0.55, 0.9]);

const css = (color, light, alpha = 1) => {
  const [r, g, b] = color.map((c) => Math.round(Math.max(0, Math.min(255, light <= 1 ? c * light : c + (255 - c) * (light - 1)))));
  return alpha < 1 ? `rgba(${r},${g},${b},${alpha})` : `rgb(${r},${g},${b})`;
};

/** Bounds on the screen; null for a solid that is not wholly before the eye. */
function bounds(solid, camera) {
  const p = camera.project(solid.center);
  const r = solid.kind === "box" || solid.kind === "ellipsoid" ? norm(solid.half)
    : solid.kind === "ball" ? solid.radius : Math.hypot(solid.radius, solid.length / 2);
  const d = camera.depth(solid.center);
  if (!p || !Number.isFinite(p[0] + p[1]) || d - r < camera.near) return null;
  const size = (camera.focal * r) / (d - r);
  return [p[0] - size, p[1] - size, p[0] + size, p[1] + size];
}

function polygon(pen, corners) {
  pen.beginPath();
  corners.forEach((p, k) => (k ? pen.lineTo(p[0], p[1]) : pen.moveTo(p[0], p[1])));
  pen.closePath();
}

function drawBall(pen, solid, camera) {
  const [x, y] = camera.project(solid.center), away = sub(camera.eye, solid.center);
  const r = (camera.focal * solid.radius) / Math.sqrt(Math.max(1e-12, dot(away, away) - solid.radius ** 2));
  const view = unit(away), right = unit(cross(camera.up, view)), up = cross(view, right);
  pen.beginPath();
  pen.arc(x, y, r, 0, 2 * Math.PI);
  pen.fillStyle = css(solid.color, 0.92);
  pen.fill();
  if (!solid.plain && r > 2) {
    /* the halves on the positive sides of two body axes; even-odd leaves the quarters */
    pen.beginPath();
    for (const n of solid.axes.slice(0, 2)) {
      const a = Math.atan2(-dot(n, up), dot(n, right)), c = dot(n, view);
      pen.moveTo(x + r * Math.cos(a - Math.PI / 2), y + r * Math.sin(a - Math.PI / 2));
      pen.arc(x, y, r, a - Math.PI / 2, a + Math.PI / 2);
      pen.ellipse(x, y, r * Math.abs(c), r, a, Math.PI / 2, -Math.PI / 2, c < 0);
    }
    pen.fillStyle = css(solid.color, 1.55);
    pen.fill("evenodd");
  }
  const shine = pen.createRadialGradient(x - 0.35 * r, y - 0.45 * r, 0.05 * r, x, y, r);
  shine.addColorStop(0, "rgba(255,255,255,0.38)");
  shine.addColorStop(0.55, "rgba(255,255,255,0)");
  shine.addColorStop(1, "rgba(0,0,0,0.42)");
  pen.beginPath();
  pen.arc(x, y, r + 0.3, 0, 2 * Math.PI);
  pen.fillStyle = shine;
  pen.fill();
}

function drawMesh(pen, solid, camera) {
  const mesh = meshOf(solid);
  const world = mesh.points.map((p) => add(solid.center, inWorld(solid.axes, p)));
  const seen = world.map((p) => camera.project(p));
  pen.lineJoin = "round";
  for (const face of mesh.faces) {
    const n = inWorld(solid.axes, face.normal);
    if (dot(n, sub(camera.eye, world[face.at[0]])) <= 0 && !solid.ghost) continue;
    const bright = 0.62 + 0.38 * Math.max(0, dot(n, LIGHT)) + 0.06 * dot(n, camera.up);
    const tint = face.light && !solid.plain ? bright + 0.42 : bright;
    polygon(pen, face.at.map((i) => seen[i]));
    pen.fillStyle = css(solid.color, tint, solid.ghost ? 0.1 : 1);
    pen.strokeStyle = face.edged ? css(solid.color, 0.45) : pen.fillStyle;
    pen.lineWidth = face.edged ? 1.1 : 0.8;
    pen.fill();
    pen.stroke();
  }
}

const drawSolid = (pen, solid, camera) =>
  (solid.kind === "ball" ? drawBall : drawMesh)(pen, solid, camera);

/** Corners of what the solid hides of a plane from light along its normal. */
function shadowOf(solid, point, normal, [u, v]) {
  const flat = (p) => [dot(sub(p, point), u), dot(sub(p, point), v)];
  if (solid.kind === "ball") {
    const [x, y] = flat(solid.center);
    return Array.from({ length: 20 }, (_, k) => [
      x + solid.radius * Math.cos((Math.PI * k) / 10), y + solid.radius * Math.sin((Math.PI * k) / 10)]);
  }
  return hull(meshOf(solid).points.map((p) => flat(add(solid.center, inWorld(solid.axes, p)))));
}

/** Convex hull of points in a plane, in order. */
function hull(points) {
  const sorted = points.sort((p, q) => p[0] - q[0] || p[1] - q[1]);
  const half = (rows) => {
    const found = [];
    for (const p of rows) {
      for (let k = found.length; k > 1; k = found.length) {
        const [a, b] = [found[k - 2], found[k - 1]];
        if ((b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]) > 0) break;
        found.pop();
      }
      found.push(p);
    }
    found.pop();
    return found;
  };
  return [...half(sorted), ...half(sorted.slice().reverse())];
}
