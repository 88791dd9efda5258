"use strict";
/* Shared state of the page, the chart of views and the residual pictures. scene.js draws the 3D view. */
const report = (() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const tip = document.getElementById("tip");
  const listeners = [];
  const painters = [];
  const state = { view: null };
  const round = (x, digits = 3) => (x === null || x === undefined ? "–" : Number(x.toPrecision(digits)).toString());

  function colour(name) {
    return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
  }
  function choose(index) {
    if (index === state.view || !data.views[index]) return;
    state.view = index;
    listeners.forEach((listener) => listener(data.views[index], index));
  }
  function showTip(text, event) {
    if (!text) { tip.hidden = true; return; }
    tip.textContent = text;
    tip.hidden = false;
    const left = Math.min(event.pageX + 14, document.documentElement.clientWidth - tip.offsetWidth - 8);
    tip.style.left = `${Math.max(4, left)}px`;
    tip.style.top = `${event.pageY + 16}px`;
  }
  /* A view's name, with its camera's where there are several. */
  const several = new Set(data.views.map((view) => view.camera)).size > 1;
  const nameOf = (view) => (several ? `${view.camera} ${view.id}` : view.id);
  function describe(view) {
    const lines = [`${nameOf(view)}: ${view.status}`];
    if (view.points) lines.push(`${view.points} points`);
    if (view.rms !== null) lines.push(`RMS ${round(view.rms)} px, both axes`);
    if (view.mm !== null) lines.push(`loop ${round(view.mm)} mm, ${round(view.deg)} deg`);
    if (view.reason) lines.push(view.reason);
    return lines;
  }
  /* Size a canvas to its box at the screen's resolution; returns its context in CSS pixels. */
  function fit(canvas, aspect) {
    const width = canvas.clientWidth || 600, height = Math.round(width * aspect);
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    /* The ratio, not the height: a page that is printed narrower must not squeeze the picture. */
    canvas.style.aspectRatio = `${width} / ${height}`;
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
    const context = canvas.getContext("2d");
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    return { context, width, height };
  }
  function repaint() { painters.forEach((paint) => paint()); }
  let pending = 0;
  function later() { cancelAnimationFrame(pending); pending = requestAnimationFrame(repaint); }
  window.addEventListener("resize", later);
  window.addEventListener("beforeprint", repaint);
  window.addEventListener("afterprint", repaint);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", repaint);
  return { data, state, nameOf, colour, choose, showTip, describe, fit, round, later, repaint,
    onChoose: (listener) => listeners.push(listener), onPaint: (paint) => { painters.push(paint); } };
})();

/* The chart: one bar a view. */
(() => {
  const root = document.getElementById("bars");
  if (!root) return;
  const { data, state, round } = report;
  const svg = root.querySelector("svg"), status = root.querySelector(".status"), group = root.querySelector(".metric");
  const metrics = [["rms", "px"], ["mm", "mm"], ["deg", "deg"]].filter(([key]) => data.views.some((v) => v[key] !== null));
  if (!metrics.length) { root.hidden = true; return; }
  let metric = metrics[0];
  const NS = "http://www.w3.org/2000/svg";
  function add(parent, name, attributes, text) {
    const node = document.createElementNS(NS, name);
    for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
    if (text !== undefined) node.textContent = text;
    parent.append(node);
    return node;
  }
  function tickStep(most) {
    const raw = most / 4, power = 10 ** Math.floor(Math.log10(raw));
    return [1, 2, 5, 10].map((k) => k * power).find((step) => step >= raw);
  }
  function hatch() {
    const pattern = add(add(svg, "defs", {}), "pattern", { id: "hatch", width: 5, height: 5, patternUnits: "userSpaceOnUse", patternTransform: "rotate(45)" });
    add(pattern, "rect", { width: 2, height: 5, fill: report.colour("soft") });
  }
  function paint() {
    /* The line of all views has its words beside the bars, never over one. */
    const [key, unit] = metric, beside = key === "rms" && data.rms !== null;
    const box = { left: 68, right: beside ? 96 : 10, top: 10, bottom: 26, height: 230 };
    const count = data.views.length, available = root.clientWidth || 600;
    const width = Math.max(available, box.left + box.right + 5 * count), span = width - box.left - box.right;
    const most = Math.max(...data.views.map((v) => v[key] ?? 0), key === "rms" ? data.rms ?? 0 : 0) || 1;
    const step = tickStep(most), top = Math.ceil(most / step) * step;
    const y = (value) => box.top + (1 - value / top) * (box.height - box.top - box.bottom);
    svg.replaceChildren();
    svg.setAttribute("width", width);
    svg.setAttribute("height", box.height);
    hatch();
    const soft = report.colour("soft"), line = report.colour("line"), font = { fill: soft, "font-size": 12 };
    for (let value = 0; value <= top + step / 2; value += step) {
      add(svg, "line", { x1: box.left, x2: width - box.right, y1: y(value), y2: y(value), stroke: line });
      add(svg, "text", { x: box.left - 8, y: y(value) + 4, "text-anchor": "end", ...font }, value + step / 2 < top ? round(value) : `${round(value)} ${unit}`);
    }
    const pitch = span / count, bar = Math.min(Math.max(pitch * 0.72, 2), 46);
    const every = Math.ceil((Math.max(...data.views.map((v) => report.nameOf(v).length)) * 7 + 10) / pitch);
    data.views.forEach((view, i) => {
      const x = box.left + (i + 0.5) * pitch, value = view[key];
      const fill = !view.used ? "url(#hatch)" : report.colour(view.reason ? "orange" : "blue");
      if (value !== null) {
        const edge = i === state.view ? report.colour("ink") : view.used ? "none" : soft;
        add(svg, "rect", { x: x - bar / 2, width: bar, y: y(value), height: Math.max(y(0) - y(value), 1), fill, stroke: edge, "stroke-width": i === state.view ? 2 : 1 });
      }
      else add(svg, "text", { x, y: y(0) - 4, "text-anchor": "middle", ...font }, "×");
      if (i % every === 0) add(svg, "text", { x, y: box.height - 8, "text-anchor": "middle", ...font, fill: i === state.view ? report.colour("ink") : soft }, report.nameOf(view));
    });
    if (beside) {
      add(svg, "line", { x1: box.left, x2: width - box.right, y1: y(data.rms), y2: y(data.rms), stroke: report.colour("ink"), "stroke-dasharray": "5 4" });
      add(svg, "text", { x: width - box.right + 6, y: y(data.rms) + 4, ...font, fill: report.colour("ink") }, `all ${round(data.rms)} px`);
    }
    svg.dataset.left = box.left;
    svg.dataset.pitch = pitch;
  }
  function at(event) {
    const i = Math.floor((event.clientX - svg.getBoundingClientRect().left - svg.dataset.left) / svg.dataset.pitch);
    return i >= 0 && i < data.views.length ? i : null;
  }
  svg.addEventListener("pointermove", (event) => {
    const i = at(event);
    report.showTip(i === null ? "" : report.describe(data.views[i]).join("\n"), event);
  });
  svg.addEventListener("pointerleave", (event) => report.showTip("", event));
  svg.addEventListener("click", (event) => { const i = at(event); if (i !== null) report.choose(i); });
  svg.addEventListener("keydown", (event) => {
    const move = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (!move) return;
    event.preventDefault();
    report.choose(Math.min(Math.max((state.view ?? -1) + move, 0), data.views.length - 1));
  });
  metrics.forEach((choice) => {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = choice[0] === "rms" ? "RMS, px" : `loop, ${choice[1]}`;
    button.setAttribute("aria-pressed", choice === metric);
    button.addEventListener("click", () => {
      metric = choice;
      group.querySelectorAll("button").forEach((other) => other.setAttribute("aria-pressed", other === button));
      paint();
    });
    group.append(button);
  });
  report.onPaint(paint);
  report.onChoose((view) => { status.textContent = report.describe(view).join(" · "); paint(); });
  paint();
})();

/* The residual pictures: one view over its photo, and all views over the image. */
(() => {
  const one = document.getElementById("one"), all = document.getElementById("all");
  if (!one) return;
  const { data, state, round } = report;
  const FACTORS = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000];
  const drawable = data.views.map((view, i) => i).filter((i) => data.views[i].uv.length);
  const photos = new Map();

  function photo(key, done) {
    if (!data.pictures[key]) return null;
    if (!photos.has(key)) {
      const image = new Image();
      image.onload = done;
      image.src = data.pictures[key];
      photos.set(key, image);
    }
    const image = photos.get(key);
    return image.complete && image.naturalWidth ? image : null;
  }
  /* The factor that makes all but the longest arrows about a twenty-fifth of the image's width. */
  function suggested(lengths, width) {
    if (!lengths.length) return 1;
    const sorted = [...lengths].sort((a, b) => a - b), typical = sorted[Math.floor(0.9 * (sorted.length - 1))] || 1e-6;
    return FACTORS.reduce((best, f) => (f * typical <= width / 25 ? f : best), FACTORS[0]);
  }
  function lengthsOf(r) {
    const out = [];
    for (let i = 0; i < r.length; i += 2) out.push(Math.hypot(r[i], r[i + 1]));
    return out;
  }
  function fill(select, factor) {
    select.replaceChildren(...FACTORS.map((f) => new Option(String(f), f, f === factor, f === factor)));
    select.value = factor;
  }
  function arrows(context, uv, r, scale, factor, style) {
    const trace = () => {
      context.beginPath();
      for (let i = 0; i < uv.length; i += 2) {
        const x = (uv[i] + 0.5) * scale, y = (uv[i + 1] + 0.5) * scale;
        const dx = r[i] * factor * scale, dy = r[i + 1] * factor * scale, length = Math.hypot(dx, dy);
        context.moveTo(x, y);
        context.lineTo(x + dx, y + dy);
        if (!style.heads || length < 3) continue;
        const head = Math.min(5, 0.45 * length), a = Math.atan2(dy, dx);
        context.lineTo(x + dx - head * Math.cos(a - 0.45), y + dy - head * Math.sin(a - 0.45));
        context.moveTo(x + dx, y + dy);
        context.lineTo(x + dx - head * Math.cos(a + 0.45), y + dy - head * Math.sin(a + 0.45));
      }
      context.stroke();
    };
    context.lineCap = "round";
    if (style.halo) { context.strokeStyle = style.halo; context.lineWidth = style.width + 2.2; trace(); }
    context.strokeStyle = style.colour;
    context.lineWidth = style.width;
    trace();
  }
  /* Means over a grid of cells, as [uv, r] lists. */
  function cellMeans(views, size) {
    const columns = 12, rows = Math.max(1, Math.round((12 * size[1]) / size[0]));
    const sums = Array.from({ length: columns * rows }, () => [0, 0, 0]);
    views.forEach((view) => {
      for (let i = 0; i < view.uv.length; i += 2) {
        const x = Math.min(columns - 1, Math.max(0, Math.floor(((view.uv[i] + 0.5) / size[0]) * columns)));
        const y = Math.min(rows - 1, Math.max(0, Math.floor(((view.uv[i + 1] + 0.5) / size[1]) * rows)));
        const cell = sums[y * columns + x];
        cell[0] += 1; cell[1] += view.r[i]; cell[2] += view.r[i + 1];
      }
    });
    const uv = [], r = [];
    sums.forEach(([n, dx, dy], k) => {
      if (n < 5) return; /* a mean of fewer says little */
      uv.push((((k % columns) + 0.5) / columns) * size[0], ((Math.floor(k / columns) + 0.5) / rows) * size[1]);
      r.push(dx / n, dy / n);
    });
    return [uv, r];
  }

  const select = one.querySelector('select[aria-label="View"]'), oneFactor = one.querySelector(".factor");
  drawable.forEach((i) => {
    const view = data.views[i];
    select.append(new Option(`${report.nameOf(view)} (${round(view.rms)} px${view.status === "used" ? "" : `, ${view.status}`})`, i));
  });
  let current = drawable[0];
  function paintOne() {
    const view = data.views[current], size = view.size, canvas = one.querySelector("canvas");
    const { context, width, height } = report.fit(canvas, size[1] / size[0]), scale = width / size[0];
    context.fillStyle = report.colour("panel");
    context.fillRect(0, 0, width, height);
    const image = photo(view.key, () => { if (data.views[current] === view) paintOne(); });
    if (image) context.drawImage(image, 0, 0, width, height);
    context.fillStyle = image ? "#5ec8ff" : report.colour("blue");
    for (let i = 0; i < view.uv.length; i += 2) {
      context.beginPath();
      context.arc((view.uv[i] + 0.5) * scale, (view.uv[i + 1] + 0.5) * scale, 1.8, 0, 2 * Math.PI);
      context.fill();
    }
    /* Points that were left out: a cross where each was seen, no arrow (it would cover the others). */
    context.strokeStyle = image ? "#ff5a6e" : report.colour("fail");
    context.lineWidth = 2;
    context.beginPath();
    for (let i = 0; i < view.out.length; i += 2) {
      const x = (view.out[i] + 0.5) * scale, y = (view.out[i + 1] + 0.5) * scale;
      context.moveTo(x - 5, y - 5); context.lineTo(x + 5, y + 5);
      context.moveTo(x - 5, y + 5); context.lineTo(x + 5, y - 5);
    }
    context.stroke();
    const style = image ? { colour: "#ff9d3c", halo: "rgba(0,0,0,.65)" } : { colour: report.colour("orange") };
    const factor = Number(oneFactor.value);
    arrows(context, view.uv, view.r, scale, factor, { ...style, width: 1.5, heads: true });
    const text = report.describe(view).join(" · "), lost = view.out.length / 2;
    const crosses = lost ? ` ${lost} point${lost > 1 ? "s were" : " was"} left out: the crosses.` : "";
    one.querySelector(".status").textContent = `${text}. Arrows are drawn ${factor} times their length.${crosses}`;
    select.value = current;
  }
  function show(index) {
    if (!drawable.includes(index)) return;
    current = index;
    paintOne();
  }
  const everyLength = drawable.flatMap((i) => lengthsOf(data.views[i].r));
  fill(oneFactor, suggested(everyLength, data.views[current].size[0]));
  select.addEventListener("change", () => { show(Number(select.value)); report.choose(current); });
  oneFactor.addEventListener("change", paintOne);
  one.querySelectorAll("[data-step]").forEach((button) => button.addEventListener("click", () => {
    const position = drawable.indexOf(current) + Number(button.dataset.step);
    show(drawable[(position + drawable.length) % drawable.length]);
    report.choose(current);
  }));
  one.querySelector("canvas").addEventListener("pointermove", (event) => {
    const view = data.views[current], box = event.currentTarget.getBoundingClientRect();
    const x = ((event.clientX - box.left) / box.width) * view.size[0], y = ((event.clientY - box.top) / box.height) * view.size[1];
    let best = null, nearest = (14 * view.size[0]) / box.width;
    for (let i = 0; i < view.uv.length; i += 2) {
      const d = Math.hypot(view.uv[i] - x, view.uv[i + 1] - y);
      if (d < nearest) { nearest = d; best = i; }
    }
    report.showTip(best === null ? "" : `seen at (${view.uv[best]}, ${view.uv[best + 1]}) px\npredicted − seen: ${round(view.r[best])}, ${round(view.r[best + 1])} px`, event);
  });
  one.querySelector("canvas").addEventListener("pointerleave", (event) => report.showTip("", event));

  const mode = all.querySelector(".mode"), allFactor = all.querySelector(".factor");
  const several = new Set(data.views.map((view) => view.camera)).size > 1;
  const used = drawable.map((i) => data.views[i]).filter((view) => view.used);
  /* Of several cameras, the one of the chosen view. */
  let size = data.views[current].size, together = [];
  function gather() {
    const chosen = data.views[current], camera = used.some((view) => view.camera === chosen.camera) ? chosen.camera : used[0].camera;
    together = used.filter((view) => view.camera === camera);
    size = together[0].size;
  }
  function allVectors() {
    if (mode.value === "cells") return cellMeans(together, size);
    return [together.flatMap((view) => view.uv), together.flatMap((view) => view.r)];
  }
  function paintAll() {
    gather();
    const { context, width, height } = report.fit(all.querySelector("canvas"), size[1] / size[0]), scale = width / size[0];
    context.fillStyle = report.colour("panel");
    context.fillRect(0, 0, width, height);
    const [uv, r] = allVectors(), factor = Number(allFactor.value), means = mode.value === "cells";
    context.globalAlpha = means || uv.length < 4000 ? 1 : 0.55;
    arrows(context, uv, r, scale, factor, { colour: report.colour("blue"), width: means ? 1.8 : 0.9, heads: true });
    context.globalAlpha = 1;
    const what = means ? `mean residuals of the cells with at least 5 points` : `${uv.length / 2} points of ${together.length} views${several ? ` of ${together[0].camera}` : ""}`;
    all.querySelector(".status").textContent = `${what}; arrows are drawn ${factor} times their length.`;
  }
  function suggestAll() { gather(); fill(allFactor, suggested(lengthsOf(allVectors()[1]), size[0])); }
  mode.addEventListener("change", () => { suggestAll(); paintAll(); });
  allFactor.addEventListener("change", paintAll);
  if (used.length) { suggestAll(); report.onPaint(paintAll); paintAll(); }
  else all.hidden = true;
  report.onPaint(paintOne);
  report.onChoose((view, index) => { show(index); if (several && used.length) paintAll(); });
  paintOne();
})();
