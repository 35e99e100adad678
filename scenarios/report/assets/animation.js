// The beams stand on their clamps; z1 is up, z2 across the beams, z3 the deflection, seen from an angle.

{
  const a = data.animation;
  const element = id => document.getElementById(id);
  const canvas = element("beams"), slider = element("time"), play = element("play"), angle = element("angle");
  const ghostBox = element("ghost"), factor = element("exaggeration");
  const pen = canvas.getContext("2d");

  const levels = packed => packed && {values: new Int16Array(bytes(packed.levels)), scale: packed.scale};
  const shapes = levels(a.shapes), ghost = levels(a.ghost), voltages = levels(a.voltages);
  const largest = packed => packed ? packed.values.reduce((m, v) => Math.max(m, Math.abs(v)), 0) * packed.scale : 0;
  const length = Math.max(...a.beams.map(b => b.length));
  const spacing = Math.max(0.4 * length, 1.6 * Math.max(...a.beams.map(b => b.width)));
  const deflection = Math.max(largest(shapes), largest(ghost)) || 1e-3;
  const nice = v => { const p = 10 ** Math.floor(Math.log10(v)); return p * ([1, 2, 5].findLast(k => k * p <= v * 1.0001) ?? 1); };
  const limit = largest(voltages) > 0 ? 10 ** Math.ceil(Math.log10(largest(voltages)) - 1e-9) : 1;
  const full = limit / 5 >= largest(voltages) ? limit / 5 : limit / 2 >= largest(voltages) ? limit / 2 : limit;

  const usual = Math.max(1, nice(0.25 * length / deflection));
  for (const f of [...new Set([1, usual / 10, usual / 5, usual / 2, usual, usual * 2])].filter(f => f >= 1).sort((x, y) => x - y)) {
    factor.add(new Option(`${f} ×`, f, f === usual, f === usual));
  }
  document.querySelector("[data-end=high]").textContent = `+${full} V`;
  document.querySelector("[data-end=low]").textContent = `−${full} V`;
  slider.max = a.frames - 1;

  // Values of a frame that may lie between two recorded ones
  function at(packed, width, position) {
    const k = Math.min(Math.floor(position), a.frames - 2), part = position - k;
    const row = k * width;
    return i => packed.scale * ((1 - part) * packed.values[row + i] + part * packed.values[row + width + i]);
  }

  function rgb(name) {
    pen.fillStyle = colour(name);
    return [1, 3, 5].map(i => parseInt(pen.fillStyle.slice(i, i + 2), 16));
  }

  let position = 0, colours = {};
  function readColours() {
    for (const name of ["beam", "edge", "spring", "ghost", "floor", "mass", "faint", "ink", "curve-3", "raised"]) colours[name] = colour(name);
    for (const name of ["negative", "neutral", "positive"]) colours[name] = rgb(name);
  }
  function voltageColour(v) {
    const end = v < 0 ? colours.negative : colours.positive, share = Math.min(Math.abs(v) / full, 1);
    return `rgb(${colours.neutral.map((c, i) => Math.round(c + share * (end[i] - c)))})`;
  }

  function view() {
    const turn = angle.value * Math.PI / 180, tilt = 0.32;
    const [c, s, up, lean] = [Math.cos(turn), Math.sin(turn), Math.cos(tilt), Math.sin(tilt)];
    const flat = (across, out, high) => [across * c + out * s, -high * up + (out * c - across * s) * lean];
    const reach = Math.min(deflection * factor.value, 0.7 * length), half = spacing * (a.beams.length - 1) / 2 + spacing * 0.45;
    const corners = [-1, 1].flatMap(x => [-1, 1].flatMap(y => [0, 1.04 * length].map(z => flat(x * half, y * Math.max(reach, 0.12 * length), z))));
    const box = [0, 1].flatMap(i => [Math.min(...corners.map(p => p[i])), Math.max(...corners.map(p => p[i]))]);
    const width = canvas.clientWidth, height = canvas.clientHeight, margin = 22, right = width > 600 ? margin : 64;
    const zoom = Math.min((width - margin - right) / (box[1] - box[0]), (height - 2 * margin) / (box[3] - box[2]));
    const x0 = (width - right + margin) / 2 - zoom * (box[0] + box[1]) / 2, y0 = height / 2 - zoom * (box[2] + box[3]) / 2;
    return {half, zoom, point: (...p) => { const [x, y] = flat(...p); return [x0 + zoom * x, y0 + zoom * y]; }};
  }

  function path(points, close) {
    pen.beginPath();
    points.forEach((p, i) => i ? pen.lineTo(...p) : pen.moveTo(...p));
    if (close) pen.closePath();
  }
  function dot(p, radius, fill) {
    pen.beginPath();
    pen.arc(...p, radius, 0, 2 * Math.PI);
    pen.fillStyle = fill;
    pen.fill();
  }

  function draw() {
    const density = devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
    if (!width || !height) return;
    if (canvas.width !== Math.round(width * density) || canvas.height !== Math.round(height * density)) {
      canvas.width = Math.round(width * density);
      canvas.height = Math.round(height * density);
    }
    pen.setTransform(density, 0, 0, density, 0, 0);
    pen.clearRect(0, 0, width, height);
    pen.lineJoin = "round";
    const {half, zoom, point} = view();
    const scale = +factor.value, n = a.stations;
    const across = j => (j - (a.beams.length - 1) / 2) * spacing;
    const places = j => Array.from({length: n}, (_, i) => a.beams[j].length * i / (n - 1));
    const volts = at(voltages, a.patches.length, position);

    // w of a packed set on beam j at z, linear between stations
    const deflected = (packed, j) => {
      const value = at(packed, a.beams.length * n, position);
      return z => {
        const x = Math.min(Math.max(z / a.beams[j].length, 0), 1) * (n - 1), i = Math.min(Math.floor(x), n - 2);
        return scale * ((1 - x + i) * value(j * n + i) + (x - i) * value(j * n + i + 1));
      };
    };
    const ribbon = (j, w, zs, wide) => [
      ...zs.map(z => point(across(j) - wide / 2, w(z), z)), ...[...zs].reverse().map(z => point(across(j) + wide / 2, w(z), z))];

    const deep = 0.12 * length;
    path([point(-half, -deep, 0), point(half, -deep, 0), point(half, deep, 0), point(-half, deep, 0)], true);
    pen.fillStyle = colours.floor;
    pen.fill();

    // Far beams first
    const order = a.beams.map((_, j) => j).reverse();
    for (const j of order) {
      const beam = a.beams[j], w = deflected(shapes, j), zs = places(j);
      pen.setLineDash([2, 4]);
      path([point(across(j), 0, 0), point(across(j), 0, beam.length)]);
      pen.lineWidth = 1;
      pen.strokeStyle = colours.faint;
      pen.stroke();
      pen.setLineDash([]);
      path(ribbon(j, w, zs, beam.width), true);
      pen.fillStyle = colours.beam;
      pen.fill();
      pen.lineWidth = 1.2;
      pen.strokeStyle = colours.edge;
      pen.stroke();
      a.patches.forEach((patch, k) => {
        if (patch.beam !== j) return;
        path(ribbon(j, w, Array.from({length: 9}, (_, i) => patch.start + (patch.end - patch.start) * i / 8), patch.width), true);
        pen.fillStyle = voltageColour(volts(k));
        pen.fill();
        pen.lineWidth = 1;
        pen.strokeStyle = colours.edge;
        pen.stroke();
      });
      if (ghost && ghostBox.checked) {
        path(ribbon(j, deflected(ghost, j), zs, beam.width), true);
        pen.setLineDash([6, 4]);
        pen.lineWidth = 1.8;
        pen.strokeStyle = colours.ghost;
        pen.stroke();
        pen.setLineDash([]);
      }
      if (beam.mass > 0) dot(point(across(j), w(beam.length), beam.length), zoom * 0.03 * length * Math.cbrt(beam.mass / 0.03), colours.mass);
      a.points.forEach((p, k) => {
        if (p.beam !== j) return;
        const spot = point(across(j), w(p.position), p.position);
        dot(spot, 4.5, colours["curve-3"]);
        pen.fillStyle = colours.ink;
        pen.font = "600 12px system-ui, sans-serif";
        pen.fillText(k + 1, spot[0] + zoom * beam.width / 2 + 7, spot[1] + 4);
      });
    }
    for (const [i, j] of a.springs) {
      const ends = [i, j].map(b => point(across(b), deflected(shapes, b)(a.beams[b].length), a.beams[b].length));
      const [dx, dy] = [ends[1][0] - ends[0][0], ends[1][1] - ends[0][1]], far = Math.hypot(dx, dy) || 1;
      const turns = 14, high = Math.min(6, far / 8);
      path(Array.from({length: turns + 1}, (_, k) => {
        const share = k === 0 ? 0 : k === turns ? 1 : 0.14 + 0.72 * (k - 0.5) / (turns - 1);
        const side = k === 0 || k === turns ? 0 : (k % 2 ? high : -high);
        return [ends[0][0] + share * dx - side * dy / far, ends[0][1] + share * dy + side * dx / far];
      }));
      pen.lineWidth = 1.6;
      pen.strokeStyle = colours.spring;
      pen.stroke();
    }
    pen.fillStyle = colours.ink;
    pen.font = "600 14px system-ui, sans-serif";
    pen.fillText(`t = ${(position * a.interval).toFixed(2)} s`, 16, 26);
    pen.font = "12px system-ui, sans-serif";
    pen.fillStyle = colours.faint;
    pen.fillText(`deflection ${scale} ×`, 16, 44);
  }

  function show(frame) {
    position = Math.min(Math.max(frame, 0), a.frames - 1);
    const text = `${(position * a.interval).toFixed(2)} s`;
    slider.value = Math.round(position);
    slider.setAttribute("aria-valuetext", text);
    element("clock").textContent = text;
    draw();
    markTime(position * a.interval);
  }

  let last = null;
  const playing = () => play.getAttribute("aria-pressed") === "true";
  function set(on) {
    play.setAttribute("aria-pressed", on);
    play.textContent = on ? "Pause" : "Play";
    last = null;
    if (on) {
      if (position >= a.frames - 1) show(0);
      requestAnimationFrame(tick);
    }
  }
  function tick(now) {
    if (!playing()) return;
    if (last !== null) show(position + (now - last) / 1000 * element("speed").value / a.interval);
    last = now;
    if (position >= a.frames - 1) set(false);
    else requestAnimationFrame(tick);
  }

  play.addEventListener("click", () => set(!playing()));
  slider.addEventListener("input", () => { set(false); show(+slider.value); });
  for (const control of [angle, factor, ghostBox]) control?.addEventListener("input", draw);
  canvas.addEventListener("keydown", event => {
    const jump = {ArrowLeft: -1, ArrowRight: 1, ArrowDown: -1, ArrowUp: 1, PageDown: -25, PageUp: 25,
                  Home: -a.frames, End: a.frames}[event.key];
    if (event.key === " ") set(!playing());
    else if (jump) { set(false); show(Math.round(position) + jump * (event.shiftKey ? 10 : 1)); }
    else return;
    event.preventDefault();
  });
  let grabbed = null;
  canvas.addEventListener("pointerdown", event => { grabbed = [event.clientX, +angle.value]; canvas.setPointerCapture(event.pointerId); });
  canvas.addEventListener("pointermove", event => {
    if (grabbed && event.buttons) { angle.value = grabbed[1] + (event.clientX - grabbed[0]) / 4; draw(); }
  });
  canvas.addEventListener("pointerup", () => { grabbed = null; });

  element("legend").textContent = "Patches are coloured by their voltage, red dots are the points of interest"
    + (ghost ? ", the dashed outline is the reference shape of the feedforward" : "")
    + (a.springs.length ? ", zigzags the springs between the tips" : "")
    + ". Distances between the beams are not to scale.";

  new ResizeObserver(draw).observe(canvas);
  themed.push(() => { readColours(); draw(); });
  readColours();
  // Begin where there is something to see: the first frame near the largest deflection
  const width = a.beams.length * a.stations, peak = largest(shapes) * 0.98 / shapes.scale;
  const begin = shapes.values.findIndex(v => Math.abs(v) >= peak);
  show(largest(shapes) > 0 ? Math.floor(begin / width) : 0);
}
