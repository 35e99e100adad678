// Charts, each with axes of its own: curves or points over frequency, decay rate or any other quantity.

function drawChart(place, chart, height = 230) {
  const PRINTED = 330;
  const single = chart.curves.length === 1;
  chart.curves.forEach((curve, k) => { curve.colour = curve.colour ?? (single ? 2 : k % 6 + 1); });
  const box = document.createElement("div"), heading = document.createElement("h4");
  const axisName = document.createElement("small"), plot = document.createElement("div");
  box.className = "panel";
  plot.className = "plot";
  plot.tabIndex = 0;
  plot.setAttribute("role", "img");
  plot.setAttribute("aria-label",
    `${chart.title}, ${chart.y.label} over ${chart.x.label}: ${chart.curves.map(c => c.label).join(", ")}`);
  axisName.textContent = chart.y.label;
  heading.append(`${chart.title} `, axisName);
  box.append(heading, plot);
  place.append(box);

  const text = v => v == null ? "" : Math.abs(v) >= 1e5 || (v && Math.abs(v) < 1e-3) ? v.toExponential(0) : String(+v.toPrecision(5));
  // Powers of ten, as many as have room; between them 1-2-5 where there is less than one decade and a half
  const powers = (u, index, low, high) => {
    const [first, last] = [Math.ceil(Math.log10(low) - 1e-9), Math.floor(Math.log10(high) + 1e-9)];
    const stride = Math.max(1, Math.ceil((last - first) / (index ? 6 : 7)));
    const factors = Math.log10(high / low) < 1.5 ? [1, 2, 5] : [1], splits = [];
    for (let power = first - 1; power <= last; power += factors.length > 1 ? 1 : stride)
      splits.push(...factors.map(f => f * 10 ** (factors.length > 1 ? power : power + 1)));
    return splits.filter(v => v >= low * (1 - 1e-9) && v <= high * (1 + 1e-9));
  };
  const axis = scale => ({
    stroke: () => colour("faint"), grid: {stroke: () => colour("line"), width: 1}, font: "12px system-ui, sans-serif",
    ticks: {stroke: () => colour("line"), width: 1},
    values: (_, splits) => splits.map(text), ...(scale.log ? {splits: powers} : {})});
  const scale = s => s.log ? {distr: 3} : {};
  const margin = (low, high) => chart.points && low > 0 ? (chart.x.log ? [low / 1.5, high * 1.5] : [low - 1, high + 1]) : [low, high];
  let values = [], position = null;
  const uplot = new uPlot({
    width: plot.clientWidth, height, legend: {show: false}, padding: [10, 12, 0, 0],
    scales: {x: {time: false, ...scale(chart.x), range: (_, low, high) => margin(low, high)},
             y: {...scale(chart.y), ...(chart.y.log ? {range: (_, low, high) => [low / 1.4, high * 1.4]} : {})}},
    axes: [{...axis(chart.x), size: 46, space: 45, label: chart.x.label, labelSize: 18, labelFont: "12px system-ui, sans-serif"},
           {...axis(chart.y), size: (u, texts) => 20 + 7.5 * Math.max(2, ...(texts ?? []).map(t => (t ?? "").length))}],
    cursor: {drag: {x: true, y: false}, points: {size: 7}},
    series: [{}, ...chart.curves.map(curve => ({
      label: curve.label, stroke: () => colour(`curve-${curve.colour}`), width: 1.4, spanGaps: !chart.points,
      dash: curve.dashed ? [6, 4] : undefined,
      ...(chart.fill ? {fill: () => colour(`curve-${curve.colour}`) + "40"} : {}),
      ...(chart.points
        ? {paths: () => null, points: {show: true, size: 7, fill: () => "transparent", stroke: () => colour(`curve-${curve.colour}`)}}
        : {points: {show: false}})}))],
    hooks: {
      draw: [u => {   // marks, such as limits, where they are within the chart
        for (const mark of chart.marks ?? []) {
          const at = u.valToPos(mark, "x", true), {ctx, bbox} = u;
          if (!(at >= bbox.left && at <= bbox.left + bbox.width)) continue;
          ctx.save();
          ctx.strokeStyle = colour("bad");
          ctx.lineWidth = 1.5 * devicePixelRatio;
          ctx.setLineDash([6 * devicePixelRatio, 4 * devicePixelRatio]);
          ctx.beginPath();
          ctx.moveTo(at, bbox.top);
          ctx.lineTo(at, bbox.top + bbox.height);
          ctx.stroke();
          ctx.restore();
        }
      }],
      setCursor: [u => {
        const row = u.cursor.idx;
        if (position) position.textContent = row == null ? "" : `${chart.x.short ?? chart.x.label}: ${short(u.data[0][row])}`;
        values.forEach((value, k) => {
          const here = u.cursor.idxs[k + 1], v = here == null ? null : u.data[k + 1][here];
          value.textContent = v == null ? "" : `${short(v)} ${chart.y.unit ?? ""}`;
        });
      }],
    },
  }, [read(chart.x.values), ...chart.curves.map(curve => read(curve.values))], plot);
  const names = legend(chart, uplot);
  values = names.values;
  position = document.createElement("li");
  position.className = "value screen";
  names.list.append(position);
  box.append(names.list);
  const resize = width => { if (width && width !== uplot.width) uplot.setSize({width, height}); };
  const observer = new ResizeObserver(() => resize(plot.clientWidth));
  observer.observe(plot);
  const print = () => resize(Math.min(PRINTED, plot.clientWidth || PRINTED)), restore = () => resize(plot.clientWidth);
  addEventListener("beforeprint", print);
  addEventListener("afterprint", restore);
  const redraw = () => uplot.redraw(false);
  themed.push(redraw);
  return () => {
    observer.disconnect();
    removeEventListener("beforeprint", print);
    removeEventListener("afterprint", restore);
    themed.splice(themed.indexOf(redraw), 1);
    uplot.destroy();
    box.remove();
  };
}

{
  const waiting = [...document.querySelectorAll("[data-charts]")].flatMap(
    place => data.charts[place.dataset.charts].map(chart => [place, chart]));
  const next = () => {
    if (waiting.length) {
      drawChart(...waiting.shift());
      setTimeout(next);
    }
  };
  next();
  addEventListener("beforeprint", () => waiting.splice(0).forEach(([place, chart]) => drawChart(place, chart)));
}
