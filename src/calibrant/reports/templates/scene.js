"use strict";
/* The 3D view: own perspective projection of lines and faces on a canvas, far things first. Lengths in metres. */
(() => {
  const root = document.getElementById("scene"), world = report.data.scene;
  if (!root || !world) return;
  const canvas = root.querySelector("canvas"), status = root.querySelector(".status");
  const add = (a, b, k = 1) => [a[0] + k * b[0], a[1] + k * b[1], a[2] + k * b[2]];
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const unit = (a) => { const n = Math.hypot(...a) || 1; return a.map((x) => x / n); };
  const apply = (T, p) => [0, 4, 8].map((i) => T[i] * p[0] + T[i + 1] * p[1] + T[i + 2] * p[2] + T[i + 3]);
  const origin = (T) => [T[3], T[7], T[11]];

  /* The ground: its axes e1, e2 and up, so that one code turns both a robot's world and a camera's. */
  const up = world.up, e1 = [1, 0, 0], e2 = cross(up, e1);
  const handEye = up[2] === 1;
  const colours = { base: "ink", gripper: "soft", camera: "ink", seen: "blue", robot: "orange" };
  const shown = Object.fromEntries(Object.keys(world.layers).map((key) => [key, true]));

  /* The target by camera, moved away from the target by robot by the chosen multiple of their difference. */
  let magnified = 1;
  function corners(board, layer) {
    const points = world.outline.map((p) => apply(board.T, p));
    const partner = layer === "seen" && board.of !== null ? world.boards.robot[board.of] : null;
    if (!partner || magnified === 1) return points;
    return points.map((p, i) => { const q = apply(partner.T, world.outline[i]); return add(q, add(p, q, -1), magnified); });
  }
  const everyPoint = [...world.frames.map((f) => origin(f.T)), ...world.cameras.map((c) => origin(c.T)),
    ...[...world.boards.seen, ...world.boards.robot].flatMap((b) => world.outline.map((p) => apply(b.T, p)))];
  const low = [0, 1, 2].map((k) => Math.min(...everyPoint.map((p) => p[k])));
  const high = [0, 1, 2].map((k) => Math.max(...everyPoint.map((p) => p[k])));
  const centre = low.map((value, k) => (value + high[k]) / 2);
  const radius = Math.max(0.05, ...everyPoint.map((p) => Math.hypot(...add(p, centre, -1))));
  const axis = 0.09 * radius, depth = 0.14 * radius;
  /* What a named view keeps in sight: the points, and the axes, frustums and words that stand at them. */
  const tips = (T, length) => [[length, 0, 0], [0, length, 0], [0, 0, length]].map((p) => apply(T, p));
  const framed = [...everyPoint,
    ...world.frames.filter((f) => f.view === null).flatMap((f) => [...tips(f.T, 2 * axis), add(origin(f.T), up, -0.5 * axis)]),
    ...world.cameras.flatMap((c) => [...c.rays.map((ray) => apply(c.T, ray.map((x) => x * (c.view === null ? depth : 0.6 * depth)))),
      ...(c.view === null ? [...tips(c.T, 1.6 * axis), add(origin(c.T), up, 2 * axis)] : [])])];

  const views = { start: handEye ? [-0.9, 0.42] : [-2.2, 0.3], top: [-Math.PI / 2, 1.55], front: [-Math.PI / 2, 0], side: [0, 0] };
  const eye = { azimuth: 0, elevation: 0, distance: 0, at: centre };
  const aspect = () => (window.innerWidth < 600 ? 0.9 : 0.6);
  let size = { width: 600, height: 400 }, basis = null, hits = [], hovered = null;
  function look() {
    const c = Math.cos(eye.elevation), flat = add(e1.map((x) => x * Math.cos(eye.azimuth)), e2, Math.sin(eye.azimuth));
    const back = add(flat.map((x) => x * c), up, Math.sin(eye.elevation));
    const forward = back.map((x) => -x), right = unit(cross(forward, up));
    basis = { position: add(eye.at, back, eye.distance), forward, right, above: cross(right, forward), focal: 1.25 * Math.min(size.width, 1.35 * size.height) };
  }
  /* Screen x, y and depth; null behind the eye. */
  function project(p) {
    const d = add(p, basis.position, -1), z = dot(d, basis.forward);
    if (z < 0.02 * radius) return null;
    return [size.width / 2 + (basis.focal * dot(d, basis.right)) / z, size.height / 2 - (basis.focal * dot(d, basis.above)) / z, z];
  }

  /* A named view: as near as all points stay inside the frame, and they in the middle of it. */
  function turn(name) {
    [eye.azimuth, eye.elevation] = views[name];
    eye.at = centre;
    for (let round = 0; round < 4; round++) {
      let near = 0.3 * radius, far = 8 * radius;
      for (let i = 0; i < 20; i++) {
        eye.distance = (near + far) / 2;
        if (extent().inside) far = eye.distance; else near = eye.distance;
      }
      eye.distance = far;
      const box = extent(), k = eye.distance / basis.focal;
      eye.at = add(add(eye.at, basis.right, k * box.dx), basis.above, -k * box.dy);
    }
    if (!extent().inside) eye.distance *= 1.1;
  }
  /* Whether every point is inside the frame with a margin, and how far their middle is from the frame's, px. */
  function extent() {
    look();
    const at = framed.map(project);
    if (at.some((p) => p === null)) return { inside: false, dx: 0, dy: 0 };
    const [left, right, top, bottom] = [[0, Math.min], [0, Math.max], [1, Math.min], [1, Math.max]].map(([k, pick]) => pick(...at.map((p) => p[k])));
    const dx = (left + right - size.width) / 2, dy = (top + bottom - size.height) / 2;
    const inside = Math.abs(dx) + (right - left) / 2 < 0.43 * size.width && Math.abs(dy) + (bottom - top) / 2 < 0.4 * size.height;
    return { inside, dx, dy };
  }

  function collect() {
    const items = [];
    const push = (points, style) => {
      const at = points.map(project);
      if (at.some((p) => p === null)) return;
      items.push({ at, z: at.reduce((sum, p) => sum + p[2], 0) / at.length, ...style });
    };
    const line = (a, b, stroke, width, dash) => push([a, b], { stroke, width, dash });
    const label = (p, text, colour) => push([p], { text, stroke: colour });
    const mark = (p, text, view) => { const at = project(p); if (at) hits.push({ x: at[0], y: at[1], text, view }); };
    const strong = (view) => view !== null && (view === hovered || (report.state.view !== null && report.data.views[report.state.view].key === view));

    if (handEye) ground(line);
    world.frames.forEach((frame) => {
      if (!shown[frame.layer]) return;
      const o = origin(frame.T), big = frame.view === null, length = axis * (big ? 1.7 : strong(frame.view) ? 1.25 : 0.7);
      ["x", "y", "z"].forEach((name, k) => {
        const tip = apply(frame.T, [0, 1, 2].map((i) => (i === k ? length : 0)));
        line(o, tip, report.colour(`axis-${name}`), big || strong(frame.view) ? 2.4 : 1.3);
        if (big || strong(frame.view)) label(add(o, add(tip, o, -1), 1.14), name, report.colour(`axis-${name}`));
      });
      if (big) label(add(o, up, -0.35 * axis), frame.label, report.colour("ink"));
      mark(o, frame.label, frame.view);
    });
    if (shown.camera) world.cameras.forEach((camera) => cameraItems(camera, line, push, label, mark, strong));
    ["robot", "seen"].forEach((layer) => {
      if (!shown[layer]) return;
      world.boards[layer].forEach((board) => {
        const points = corners(board, layer), focus = strong(board.view), stroke = report.colour(colours[layer]);
        push(points, { closed: true, stroke, fill: stroke, alpha: focus ? 0.3 : 0.07, width: layer === "seen" ? (focus ? 4 : 2.6) : focus ? 2.2 : 1.3, dash: layer === "robot" ? [6, 5] : null, above: layer === "robot" });
        /* The first row's start, so that a turned board shows. */
        const corner = points[0], step = 0.16;
        push([corner, add(corner, add(points[1], corner, -1), step), add(corner, add(points[3], corner, -1), step)], { closed: true, stroke, fill: stroke, alpha: 0.75, width: 1 });
        const middle = points.reduce((sum, p) => add(sum, p, 0.25), [0, 0, 0]);
        const what = layer === "seen" ? "target as the camera sees it" : "target by the robot";
        if (layer === "robot" && board.view === null) label(middle, "target", report.colour("ink"));
        mark(middle, board.label ? `${board.label}: ${what}` : what, board.view);
      });
    });
    /* Dashes over the solid outline of the same board, also when they coincide. */
    return items.sort((a, b) => b.z - (b.above ? 0.02 * radius : 0) - a.z + (a.above ? 0.02 * radius : 0));
  }
  function cameraItems(camera, line, push, label, mark, strong) {
    const o = origin(camera.T), single = camera.view === null, focus = single || strong(camera.view);
    const scale = single ? depth : 0.6 * depth, ink = report.colour(focus ? "ink" : "soft");
    const ends = camera.rays.map((ray) => apply(camera.T, ray.map((x) => x * scale)));
    ends.forEach((end, i) => { line(o, end, ink, focus ? 1.6 : 0.9); line(end, ends[(i + 1) % 4], ink, focus ? 1.6 : 0.9); });
    /* A roof on the image's upper edge says which way is up. */
    const roof = add(add(ends[0], ends[1]).map((x) => x / 2), add(add(ends[0], ends[3], -1), [0, 0, 0]), 0.3);
    push([ends[0], roof, ends[1]], { closed: true, stroke: ink, fill: ink, alpha: 0.35, width: 0.8 });
    if (single) {
      ["x", "y", "z"].forEach((name, k) => {
        const tip = apply(camera.T, [0, 1, 2].map((i) => (i === k ? axis * 1.3 : 0)));
        line(o, tip, report.colour(`axis-${name}`), 2.2);
        label(add(o, add(tip, o, -1), 1.15), name, report.colour(`axis-${name}`));
      });
      label(add(o, up, 1.7 * axis), camera.label, ink);
    }
    mark(o, camera.label, camera.view);
  }
  const gridStep = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10].find((s) => s > radius / 6) || 20;
  function ground(line) {
    const stroke = report.colour("line"), reach = Math.ceil((1.1 * radius) / gridStep);
    const cx = Math.round(centre[0] / gridStep), cy = Math.round(centre[1] / gridStep);
    for (let i = -reach; i <= reach; i++) for (let j = -reach; j < reach; j++) {
      line([(cx + i) * gridStep, (cy + j) * gridStep, 0], [(cx + i) * gridStep, (cy + j + 1) * gridStep, 0], stroke, 0.7);
      line([(cx + j) * gridStep, (cy + i) * gridStep, 0], [(cx + j + 1) * gridStep, (cy + i) * gridStep, 0], stroke, 0.7);
    }
  }

  function draw() {
    const fitted = report.fit(canvas, aspect()), context = fitted.context;
    size = fitted;
    look();
    hits = [];
    context.fillStyle = report.colour("panel");
    context.fillRect(0, 0, size.width, size.height);
    context.font = "600 12px system-ui, sans-serif";
    context.textAlign = "center";
    context.textBaseline = "middle";
    context.lineJoin = "round";
    const items = collect();
    items.filter((item) => !item.text).forEach((item) => {
      context.beginPath();
      item.at.forEach(([x, y], i) => (i ? context.lineTo(x, y) : context.moveTo(x, y)));
      if (item.closed) context.closePath();
      if (item.fill) { context.globalAlpha = item.alpha; context.fillStyle = item.fill; context.fill(); context.globalAlpha = 1; }
      context.setLineDash(item.dash || []);
      context.lineWidth = item.width;
      context.strokeStyle = item.stroke;
      context.stroke();
    });
    context.setLineDash([]);
    /* Words last: never hidden behind a board. */
    items.filter((item) => item.text).forEach(({ at: [[x, y]], text, stroke }) => {
      context.lineWidth = 3;
      context.strokeStyle = report.colour("panel");
      context.strokeText(text, x, y);
      context.fillStyle = stroke;
      context.fillText(text, x, y);
    });
    if (handEye) {
      context.textAlign = "left";
      context.fillStyle = report.colour("soft");
      context.font = "12px system-ui, sans-serif";
      context.fillText(`grid ${gridStep >= 1 ? `${gridStep} m` : `${Math.round(1000 * gridStep)} mm`}`, 10, size.height - 12);
    }
  }
  let frame = 0;
  function redraw() { cancelAnimationFrame(frame); frame = requestAnimationFrame(draw); }

  /* Hands: one pointer turns, shift or the other button moves, two pointers zoom. */
  const pointers = new Map();
  let gap = 0, moved = 0;
  function zoom(factor) { eye.distance = Math.min(Math.max(eye.distance * factor, 0.15 * radius), 20 * radius); redraw(); }
  function rotate(dx, dy) {
    eye.azimuth -= dx;
    eye.elevation = Math.min(Math.max(eye.elevation + dy, -1.55), 1.55);
    redraw();
  }
  function nearest(event) {
    const box = canvas.getBoundingClientRect(), x = event.clientX - box.left, y = event.clientY - box.top;
    let best = null, within = 16;
    hits.forEach((hit) => { const d = Math.hypot(hit.x - x, hit.y - y); if (d < within) { within = d; best = hit; } });
    return best;
  }
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, [event.clientX, event.clientY]);
    gap = 0;
    moved = 0;
  });
  canvas.addEventListener("pointermove", (event) => {
    const last = pointers.get(event.pointerId);
    if (!last) {
      const hit = nearest(event), view = hit ? hit.view : null;
      report.showTip(hit ? hit.text : "", event);
      if (view !== hovered) { hovered = view; redraw(); }
      return;
    }
    const dx = event.clientX - last[0], dy = event.clientY - last[1];
    pointers.set(event.pointerId, [event.clientX, event.clientY]);
    moved += Math.hypot(dx, dy);
    if (pointers.size === 2) {
      const [a, b] = [...pointers.values()], now = Math.hypot(a[0] - b[0], a[1] - b[1]);
      if (gap) zoom(gap / now);
      gap = now;
    } else if (event.shiftKey || event.buttons === 2) {
      const k = eye.distance / basis.focal;
      eye.at = add(add(eye.at, basis.right, -dx * k), basis.above, dy * k);
      redraw();
    } else rotate(dx * 0.008, dy * 0.008);
  });
  function release(event) {
    if (pointers.delete(event.pointerId) && moved < 4 && event.type === "pointerup") {
      const hit = nearest(event), index = hit ? report.data.views.findIndex((v) => v.key === hit.view) : -1;
      if (index >= 0) report.choose(index);
    }
    gap = 0;
  }
  canvas.addEventListener("pointerup", release);
  canvas.addEventListener("pointercancel", release);
  canvas.addEventListener("pointerleave", (event) => { report.showTip("", event); if (hovered !== null) { hovered = null; redraw(); } });
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("wheel", (event) => { event.preventDefault(); zoom(Math.exp(0.0012 * event.deltaY)); }, { passive: false });
  canvas.addEventListener("keydown", (event) => {
    const keys = { ArrowLeft: () => rotate(0.1, 0), ArrowRight: () => rotate(-0.1, 0), ArrowUp: () => rotate(0, 0.1), ArrowDown: () => rotate(0, -0.1),
      "+": () => zoom(0.88), "=": () => zoom(0.88), "-": () => zoom(1.14), 0: () => { turn("start"); redraw(); } };
    if (!keys[event.key]) return;
    event.preventDefault();
    keys[event.key]();
  });
  root.querySelectorAll("[data-turn]").forEach((button) => button.addEventListener("click", () => { turn(button.dataset.turn); redraw(); }));

  Object.entries(world.layers).forEach(([key, text]) => {
    const label = document.createElement("label"), box = document.createElement("input"), swatch = document.createElement("span");
    box.type = "checkbox";
    box.checked = true;
    box.addEventListener("change", () => { shown[key] = box.checked; redraw(); });
    swatch.className = "swatch";
    swatch.style.borderTopColor = `var(--${colours[key]})`;
    if (key === "robot") swatch.style.borderTopStyle = "dashed";
    label.append(box, swatch, document.createTextNode(` ${text}`));
    root.querySelector(".layers").append(label);
  });
  if (world.boards.robot.length && world.boards.seen.length) {
    const magnify = root.querySelector(".magnify"), range = magnify.querySelector("input"), output = magnify.querySelector("output");
    magnify.hidden = false;
    range.addEventListener("input", () => {
      magnified = Math.round(10 ** Number(range.value));
      output.textContent = magnified;
      redraw();
    });
  }
  report.onPaint(draw);
  report.onChoose((view) => { status.textContent = `Chosen: ${view.id}.`; redraw(); });
  size = report.fit(canvas, aspect());
  turn("start");
  draw();
})();
