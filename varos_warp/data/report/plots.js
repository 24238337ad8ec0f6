// Curves on canvases: a line at the time of the frame that is shown, values there, a click goes to a time.

function ticks(low, high, count) {
  const rough = (high - low) / count, power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map(m => m * power).find(s => s >= rough);
  const found = [];
  for (let i = Math.ceil(low / step - 1e-9); i * step <= high + 1e-9 * step; i++) found.push(i * step);
  return found;
}

function decades(low, high) {  // of a logarithmic axis: 1, 2, 5 times powers of ten
  const found = [];
  for (let p = Math.floor(Math.log10(low)); p <= Math.log10(high); p++) for (const m of [1, 2, 5]) found.push(m * 10 ** p);
  const inside = found.filter(v => v >= low * 0.999 && v <= high * 1.001);
  return inside.length ? inside : [low, high];
}

const label = value => Math.abs(value) >= 1e5 || (value && Math.abs(value) < 1e-3) ? value.toExponential(1) : String(+value.toPrecision(4));

function limits(plot) {
  const values = plot.y.flat().filter(v => v !== null && (!plot.log || v > 0));
  let low = Math.min(...minmax(values)), high = Math.max(...minmax(values));
  if (!values.length) [low, high] = plot.log ? [0.1, 10] : [0, 1];
  if (plot.zero) low = 0;
  if (plot.log) { const pad = (high / low) ** 0.06 * (high / low < 1.2 ? 1.25 : 1.02); return [low / pad, high * pad]; }
  const pad = (high - low) * 0.06 || Math.abs(high) * 0.05 || 0.5;
  return [plot.zero ? 0 : low - pad, high + pad];
}

function minmax(values) {
  let low = Infinity, high = -Infinity;
  for (const v of values) { if (v < low) low = v; if (v > high) high = v; }
  return [low, high];
}

function buildPlot(plot, place) {
  const canvas = element("canvas", { role: "img" });
  canvas.setAttribute("aria-label", `${plot.title} in ${plot.unit}`);
  const head = element("header", {}, element("b", {}, plot.title), element("em", {}, plot.unit));
  const values = plot.names.map((name, i) => {
    const value = element("span", {}), key = element("span", { className: i ? "key" : "key first" }, element("i", {}), name, value);
    head.append(key);
    return [key.firstChild, value];
  });
  place.append(element("figure", { className: "plot card" }, head, canvas));

  const [x0, x1] = plot.x.length > 1 ? [plot.x[0], plot.x[plot.x.length - 1]] : [0, 1];
  const [y0, y1] = limits(plot), scale = plot.log ? Math.log : v => v;
  const margin = { left: 46, right: 8, top: 8, bottom: 20 };
  const X = x => margin.left + (x - x0) / (x1 - x0) * (canvas.clientWidth - margin.left - margin.right);
  const Y = y => {
    const share = (scale(y) - scale(y0)) / (scale(y1) - scale(y0));
    return margin.top + (plot.down ? share : 1 - share) * (canvas.clientHeight - margin.top - margin.bottom);
  };

  function at(x) {  // index of the last sample that is not after x
    let low = 0, high = plot.x.length - 1;
    while (low < high) { const middle = (low + high + 1) >> 1; if (plot.x[middle] <= x) low = middle; else high = middle - 1; }
    return low;
  }

  let base = null;  // the curves, drawn once
  function drawBase() {
    const ratio = devicePixelRatio || 1, w = canvas.clientWidth, h = canvas.clientHeight;
    if (!w) return;
    base = element("canvas", { width: w * ratio, height: h * ratio });
    const pen = base.getContext("2d");
    pen.scale(ratio, ratio);
    pen.font = "11px system-ui, sans-serif";
    pen.textBaseline = "middle";
    pen.textAlign = "right";
    for (const y of plot.log ? decades(y0, y1) : ticks(y0, y1, 4)) {
      pen.fillStyle = color("--line"); pen.fillRect(margin.left, Y(y), w - margin.left - margin.right, 1);
      pen.fillStyle = color("--soft"); pen.fillText(label(y), margin.left - 6, Y(y));
    }
    pen.textBaseline = "alphabetic";
    pen.textAlign = "center";
    const spread = ticks(x0, x1, Math.max(2, w / 90));
    spread.forEach((x, i) => pen.fillText(label(x) + (i === spread.length - 1 ? (plot.distance ? plot.x_unit ?? " m" : " s") : ""), Math.min(X(x), w - 14), h - 4));
    plot.y.forEach((ys, k) => {
      pen.strokeStyle = color(`--c${plot.names.length === 1 ? 2 : k % 4}`);
      pen.lineWidth = 1.3;
      pen.lineJoin = "round";
      pen.beginPath();
      let down = false;
      ys.forEach((y, i) => {
        if (y === null || (plot.log && y <= 0)) { down = false; return; }
        if (down) pen.lineTo(X(plot.x[i]), Y(y)); else pen.moveTo(X(plot.x[i]), Y(y));
        down = true;
      });
      pen.stroke();
      values[k][0].style.background = pen.strokeStyle;
    });
  }

  let hover = null;
  function draw() {
    if (!base) return;
    canvas.width = base.width; canvas.height = base.height;
    const pen = canvas.getContext("2d"), ratio = devicePixelRatio || 1;
    pen.drawImage(base, 0, 0);
    pen.scale(ratio, ratio);
    const now = plot.distance || !DATA.times.length ? null : time(state.index), x = hover === null ? now : hover;
    if (now !== null && now >= x0 && now <= x1) {
      pen.fillStyle = color("--accent");
      pen.fillRect(X(now) - 0.75, margin.top, 1.5, canvas.clientHeight - margin.top - margin.bottom);
    }
    if (hover !== null) { pen.fillStyle = color("--soft"); pen.fillRect(X(hover), margin.top, 1, canvas.clientHeight - margin.top - margin.bottom); }
    values.forEach(([, value], k) => {
      const y = x === null || !plot.x.length ? null : hover === null ? plot.at_frames[k][state.index] : plot.y[k][at(x)];
      value.textContent = y === null || y === undefined ? "" : label(y);
      if (y !== null && y !== undefined && x >= x0 && x <= x1) {
        pen.fillStyle = color(`--c${plot.names.length === 1 ? 2 : k % 4}`);
        pen.beginPath(); pen.arc(X(hover === null ? x : plot.x[at(x)]), Y(y), 3, 0, 7); pen.fill();
      }
    });
  }

  const under = event => x0 + (event.offsetX - margin.left) / (canvas.clientWidth - margin.left - margin.right) * (x1 - x0);
  canvas.onpointermove = event => {
    hover = Math.max(x0, Math.min(x1, under(event)));
    if (event.buttons && !plot.distance) showTime(hover); else draw();
  };
  canvas.onpointerleave = () => { hover = null; draw(); };
  canvas.onpointerdown = event => { if (!plot.distance) showTime(under(event)); };
  listeners.push(draw);
  const anew = () => { drawBase(); draw(); };
  repaint.push(anew);
  new ResizeObserver(anew).observe(canvas);
}
