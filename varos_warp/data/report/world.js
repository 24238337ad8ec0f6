// The world on a canvas, drawn from far to near: triangles of ground and objects (or points), the course, the cameras.

const VIEW = 0.62;  // twice the tangent of half the field of view, of the shorter side

function buildWorld() {
  const place = $("world"), world = DATA.world;
  if (!place || !world) return;
  const canvas = place.querySelector("canvas");
  const course = triples(world.course), meshes = prepare(world.meshes || {}), cloud = points(world.cloud);
  const [center, radius] = bounds(course);
  const home = { target: center, yaw: -0.9, pitch: 0.62, distance: radius * 3.6 };
  let eye = { ...home, target: [...home.target] };

  function axes() {  // right, up and forward of the eye
    const [cy, sy, cp, sp] = [Math.cos(eye.yaw), Math.sin(eye.yaw), Math.cos(eye.pitch), Math.sin(eye.pitch)];
    return { right: [-sy, cy, 0], up: [-cy * sp, -sy * sp, cp], forward: [-cy * cp, -sy * cp, -sp] };
  }

  function projector() {
    const { right, up, forward } = axes(), w = canvas.clientWidth, h = canvas.clientHeight, f = Math.min(w, h) / VIEW;
    const from = eye.target.map((t, i) => t - forward[i] * eye.distance);
    return p => {
      const d = [p[0] - from[0], p[1] - from[1], p[2] - from[2]], z = dot(d, forward);
      return [w / 2 + f * dot(d, right) / z, h / 2 - f * dot(d, up) / z, z];
    };
  }

  let scenery = null;  // what stays as it is while time goes on, drawn when the eye moves
  function drawScenery(w, h, ratio, project, near) {
    scenery = element("canvas", { width: w * ratio, height: h * ratio });
    const pen = scenery.getContext("2d"), items = [];
    pen.scale(ratio, ratio);
    for (const mesh of meshes) collect(mesh, project, near, items);
    for (const { p, fill } of cloud) { const q = project(p); if (q[2] > near) items.push([q[2], () => { pen.fillStyle = fill; const s = Math.max(1.5, 40 / q[2]); pen.fillRect(q[0], q[1], s, s); }]); }
    line(course, project, near, color("--accent"), items, pen);
    items.sort((a, b) => b[0] - a[0]);
    for (const item of items) {
      if (item.length === 2) { item[1](); continue; }
      const [, a, b, c, fill] = item;
      pen.fillStyle = pen.strokeStyle = fill;
      pen.beginPath(); pen.moveTo(a[0], a[1]); pen.lineTo(b[0], b[1]); pen.lineTo(c[0], c[1]); pen.closePath();
      pen.fill(); pen.lineWidth = 0.7; pen.stroke();
    }
  }

  function draw() {
    const ratio = devicePixelRatio || 1, w = canvas.clientWidth, h = canvas.clientHeight;
    if (!w) return;
    const project = projector(), near = eye.distance * 0.05, pen = canvas.getContext("2d");
    if (!scenery) drawScenery(w, h, ratio, project, near);
    canvas.width = w * ratio; canvas.height = h * ratio;
    pen.drawImage(scenery, 0, 0);
    pen.scale(ratio, ratio);
    for (const id of Object.keys(world.cameras)) frustum(pen, project, near, id);
    bar(pen, w, h);
  }

  function line(list, project, near, stroke, items, pen) {
    const seen = list.map(project);
    for (let i = 1; i < seen.length; i++) {
      const [a, b] = [seen[i - 1], seen[i]];
      if (a[2] < near || b[2] < near) continue;
      items.push([(a[2] + b[2]) / 2 - radius * 0.02, () => { pen.strokeStyle = stroke; pen.lineWidth = 2; pen.lineCap = "round"; pen.beginPath(); pen.moveTo(a[0], a[1]); pen.lineTo(b[0], b[1]); pen.stroke(); }]);
    }
  }

  function frustum(pen, project, near, id) {
    const camera = world.cameras[id], T = camera.poses[state.index];
    if (!T) return;
    const size = Math.max(0.35, Math.min(2.5, radius * 0.16)), [x, y] = camera.half.map(t => t * size);
    const at = (a, b, c) => project([0, 1, 2].map(i => T[4 * i] * a + T[4 * i + 1] * b + T[4 * i + 2] * c + T[4 * i + 3]));
    const tip = at(0, 0, 0), corners = [[-x, -y], [x, -y], [x, y], [-x, y]].map(([a, b]) => at(a, b, size));
    if ([tip, ...corners].some(p => p[2] < near)) return;
    const chosen = id === state.camera;
    pen.strokeStyle = pen.fillStyle = color(chosen ? "--c0" : "--soft");
    pen.lineWidth = chosen ? 1.8 : 1; pen.lineJoin = "round";
    pen.beginPath();
    corners.forEach((c, i) => (i ? pen.lineTo : pen.moveTo).call(pen, c[0], c[1]));
    pen.closePath(); pen.globalAlpha = 0.18; pen.fill(); pen.globalAlpha = 1; pen.stroke();
    for (const c of corners) { pen.beginPath(); pen.moveTo(tip[0], tip[1]); pen.lineTo(c[0], c[1]); pen.stroke(); }
    pen.beginPath(); pen.arc(tip[0], tip[1], 3.4, 0, 7); pen.fill();
  }

  function bar(pen, w, h) {  // a scale at the distance that the eye turns around
    const meter = Math.min(w, h) / VIEW / eye.distance, wanted = 90 / meter, power = 10 ** Math.floor(Math.log10(wanted));
    const length = [1, 2, 5, 10].map(m => m * power).filter(m => m <= wanted * 1.3).pop();
    const text = `${+length.toPrecision(2)} m`;
    pen.font = "12px system-ui, sans-serif";
    for (const [stroke, width] of [["--sky", 4], ["--ink", 1.5]]) {
      pen.strokeStyle = color(stroke); pen.lineWidth = width;
      pen.beginPath(); pen.moveTo(14, h - 19); pen.lineTo(14, h - 14); pen.lineTo(14 + length * meter, h - 14); pen.lineTo(14 + length * meter, h - 19); pen.stroke();
    }
    pen.lineWidth = 3; pen.strokeStyle = color("--sky"); pen.strokeText(text, 20, h - 21);
    pen.fillStyle = color("--ink"); pen.fillText(text, 20, h - 21);
  }

  // ------------------------------------------------------------------------------------------------------- the mouse

  let pending = false;
  const soon = () => { if (!pending) { pending = true; requestAnimationFrame(() => { pending = false; draw(); }); } };
  const moved = () => { scenery = null; soon(); };
  const zoom = factor => { eye.distance = Math.max(radius * 0.15, Math.min(radius * 14, eye.distance * factor)); moved(); };
  const fingers = new Map();
  canvas.onpointerdown = event => { canvas.setPointerCapture(event.pointerId); fingers.set(event.pointerId, [event.offsetX, event.offsetY]); };
  canvas.onpointerup = canvas.onpointercancel = event => fingers.delete(event.pointerId);
  canvas.onpointermove = event => {
    const before = fingers.get(event.pointerId), now = [event.offsetX, event.offsetY];
    if (!before) return;
    const [dx, dy] = [now[0] - before[0], now[1] - before[1]];
    const other = [...fingers].find(([id]) => id !== event.pointerId);
    if (other) zoom(Math.hypot(before[0] - other[1][0], before[1] - other[1][1]) / Math.max(1, Math.hypot(now[0] - other[1][0], now[1] - other[1][1])));
    else if (event.shiftKey || event.buttons === 2) {
      const { right, up } = axes(), step = eye.distance * VIEW / Math.min(canvas.clientWidth, canvas.clientHeight);
      eye.target = eye.target.map((t, i) => t + (-dx * right[i] + dy * up[i]) * step);
    } else {
      eye.yaw -= dx * 0.007;
      eye.pitch = Math.max(-0.2, Math.min(1.55, eye.pitch + dy * 0.007));
    }
    fingers.set(event.pointerId, now);
    moved();
  };
  canvas.oncontextmenu = event => event.preventDefault();
  canvas.addEventListener("wheel", event => {  // without a click before, the wheel scrolls the page
    if (document.activeElement !== canvas && !event.ctrlKey) return;
    event.preventDefault();
    zoom(Math.exp(event.deltaY * 0.0012));
  }, { passive: false });
  const look = change => { eye = { ...home, target: [...home.target], ...change }; moved(); };
  canvas.ondblclick = () => look({});
  const tools = { nearer: () => zoom(0.75), farther: () => zoom(1.33), top: () => look({ pitch: 1.55, yaw: -Math.PI / 2 }), whole: () => look({}) };
  for (const [name, act] of Object.entries(tools)) place.querySelector(`[data-tool=${name}]`).onclick = act;

  listeners.push(soon);
  repaint.push(() => { meshes.forEach(tint); moved(); });
  new ResizeObserver(moved).observe(canvas);
}

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

function triples(flat, scale = 1) {
  const found = [];
  for (let i = 0; i < flat.length; i += 3) found.push([flat[i] * scale, flat[i + 1] * scale, flat[i + 2] * scale]);
  return found;
}

function bounds(list) {
  const low = [0, 1, 2].map(i => Math.min(...list.map(p => p[i]))), high = [0, 1, 2].map(i => Math.max(...list.map(p => p[i])));
  return [low.map((l, i) => (l + high[i]) / 2), Math.max(1.5, Math.hypot(...low.map((l, i) => high[i] - l)) / 2)];
}

function points(cloud) {
  if (!cloud) return [];
  return triples(cloud.points, 1e-3).map((p, i) => ({ p, fill: `rgb(${cloud.colors.slice(3 * i, 3 * i + 3)})` }));
}

function prepare(meshes) {  // corners and how bright each triangle is, with a light from above and the side
  return Object.entries(meshes).map(([kind, mesh]) => {
    const vertices = triples(mesh.vertices, 1e-3), faces = triples(mesh.faces);
    const light = [0.35, -0.45, 0.82];
    const tones = faces.map(([a, b, c]) => {
      const [u, v] = [b, c].map(i => vertices[i].map((x, k) => x - vertices[a][k]));
      const n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
      return 0.42 + 0.58 * Math.max(0, dot(n, light)) / (Math.hypot(...n) || 1);
    });
    const made = { kind, vertices, faces, tones };
    tint(made);
    return made;
  });
}

function tint(mesh) {
  const base = color(mesh.kind === "ground" ? "--ground" : "--object").split(" ").map(Number);
  mesh.fills = mesh.tones.map(tone => `rgb(${base.map(b => Math.round(Math.min(255, b * tone * 1.25)))})`);
}

function collect(mesh, project, near, items) {
  const seen = mesh.vertices.map(project);
  mesh.faces.forEach(([a, b, c], i) => {
    const [p, q, r] = [seen[a], seen[b], seen[c]];
    if (p[2] < near || q[2] < near || r[2] < near) return;
    items.push([(p[2] + q[2] + r[2]) / 3, p, q, r, mesh.fills[i]]);
  });
}
