// Parallel coordinates: a line through all axes for each run; ranges of axes choose runs.

{
  const {axes, inputs, runs} = data.parallel, canvas = document.getElementById("lines");
  const chooser = document.getElementById("colour-by"), kept = document.getElementById("kept");
  const HEIGHT = 350, TOP = 64, BOTTOM = 26, STEP = 88;
  for (const axis of axes) {
    axis.values = read(axis.values);
    const finite = axis.values.filter(Number.isFinite);
    axis.low = Math.min(...finite);
    axis.high = Math.max(...finite);
    axis.range = null;   // values that are kept
  }
  const measures = axes.slice(inputs);
  measures.forEach((axis, k) => chooser.add(new Option(axis.label, k)));
  const limited = measures.findIndex(axis => axis.limited && axis.outside.some(Boolean));
  if (measures.length) chooser.value = Math.max(0, limited);

  const text = v => v && (Math.abs(v) >= 1e5 || Math.abs(v) < 1e-3) ? v.toExponential(2) : String(+v.toPrecision(4));
  let width = 0;
  const across = k => 48 + k * (width - 96) / Math.max(1, axes.length - 1);
  const up = (axis, v) => HEIGHT - BOTTOM - (axis.high > axis.low ? (v - axis.low) / (axis.high - axis.low) : 0.5) * (HEIGHT - TOP - BOTTOM);
  const back = (axis, y) => axis.low + (HEIGHT - BOTTOM - y) / (HEIGHT - TOP - BOTTOM) * (axis.high - axis.low);
  const isKept = n => axes.every(({range, values}) => !range || values[n] >= range[0] && values[n] <= range[1]);

  function draw() {
    const place = canvas.parentElement.clientWidth, ratio = devicePixelRatio || 1;
    width = Math.max(place, STEP * axes.length);
    canvas.width = width * ratio;
    canvas.height = HEIGHT * ratio;
    canvas.style.width = `${width}px`;
    canvas.style.height = `${HEIGHT}px`;
    const pen = canvas.getContext("2d"), by = measures[chooser.value];
    pen.scale(ratio, ratio);
    let count = 0;
    for (const kind of [0, 1]) {
      pen.strokeStyle = colour(kind ? "bad" : "accent");
      pen.globalAlpha = Math.min(0.8, kind ? 12 / Math.sqrt(runs.length * 10) + 0.1 : 6 / Math.sqrt(runs.length * 10));
      runs.forEach((_, n) => {
        if ((by?.limited ? by.outside[n] : 0) !== kind || !isKept(n)) return;
        count += 1;
        pen.beginPath();
        axes.forEach((axis, k) => pen.lineTo(across(k), up(axis, axis.values[n])));
        pen.stroke();
      });
    }
    pen.globalAlpha = 1;
    pen.font = "12px system-ui, sans-serif";
    axes.forEach((axis, k) => {
      const x = across(k);
      pen.strokeStyle = colour("faint");
      pen.beginPath();
      pen.moveTo(x, TOP);
      pen.lineTo(x, HEIGHT - BOTTOM);
      pen.stroke();
      if (axis.range) {
        pen.fillStyle = colour("accent");
        pen.globalAlpha = 0.3;
        const [a, b] = axis.range.map(v => up(axis, v));
        pen.fillRect(x - 7, Math.min(a, b), 14, Math.abs(a - b));
        pen.globalAlpha = 1;
      }
      pen.textAlign = "center";
      pen.fillStyle = colour("ink");
      const words = axis.label.split(/(?<=\.)|\s+/), lines = [""];
      for (const word of words) {
        const gap = lines.at(-1) && !lines.at(-1).endsWith(".") ? " " : "";
        if (lines.at(-1) && pen.measureText(lines.at(-1) + gap + word).width > STEP - 8) lines.push(word);
        else lines[lines.length - 1] += gap + word;
      }
      lines.slice(0, 3).forEach((line, row) => pen.fillText(line, x, 12 + 13 * row, STEP - 4));
      pen.fillStyle = colour("faint");
      pen.fillText(`${text(axis.high)} ${axis.unit}`, x, TOP - 4, STEP - 4);
      pen.fillText(`${text(axis.low)} ${axis.unit}`, x, HEIGHT - BOTTOM + 15, STEP - 4);
    });
    kept.textContent = `${count} of ${runs.length} runs shown`;
  }

  const nearest = event => {
    const box = canvas.getBoundingClientRect(), x = event.clientX - box.left, y = event.clientY - box.top;
    let k = 0;
    axes.forEach((_, n) => { if (Math.abs(across(n) - x) < Math.abs(across(k) - x)) k = n; });
    return {axis: axes[k], y: Math.min(Math.max(y, TOP), HEIGHT - BOTTOM), near: Math.abs(across(k) - x) < 24};
  };
  let from = null;
  canvas.addEventListener("pointerdown", event => {
    const {axis, y, near} = nearest(event);
    if (near) {
      from = {axis, value: back(axis, y)};
      canvas.setPointerCapture(event.pointerId);
    }
  });
  canvas.addEventListener("pointermove", event => {
    if (!from) return;
    const end = back(from.axis, nearest(event).y);
    from.axis.range = [Math.min(from.value, end), Math.max(from.value, end)];
    draw();
  });
  canvas.addEventListener("pointerup", () => { from = null; });
  canvas.addEventListener("dblclick", event => { nearest(event).axis.range = null; draw(); });
  chooser.addEventListener("change", draw);
  themed.push(draw);
  addEventListener("resize", draw);
  draw();
}
