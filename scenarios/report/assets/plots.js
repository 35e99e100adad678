// Plots with one time axis: zoom, hover and cursor are shared by all. Those near the visible part are drawn first; of a
// page with many, others are drawn when they come near it.

const plots = [];
let marked = null;   // the time at which the animation stands
const markTime = t => {
  marked = t;
  plots.forEach(p => p.mark(t));
};

{
  const group = uPlot.sync("time");
  const first = document.getElementById("from"), last = document.getElementById("to");
  const HEIGHT = 208, PRINTED = 215, FEW = 24;
  let whole = [Infinity, -Infinity], shown = null, zooming = false;

  function zoom(low, high) {
    const span = Math.min(Math.max(high - low, 1e-4), whole[1] - whole[0]);
    low = Math.min(Math.max(low, whole[0]), whole[1] - span);
    shown = [low, low + span];
    zooming = true;
    plots.forEach(p => p.chart.setScale("x", {min: shown[0], max: shown[1]}));
    zooming = false;
    [first.value, last.value] = shown.map(short);
  }

  const middle = factor => {
    const centre = (shown[0] + shown[1]) / 2, half = (shown[1] - shown[0]) / 2 * factor;
    zoom(centre - half, centre + half);
  };
  const move = share => {
    const shift = share * (shown[1] - shown[0]);
    zoom(shown[0] + shift, shown[1] + shift);
  };
  const actions = {in: () => middle(0.5), out: () => middle(2), left: () => move(-0.25), right: () => move(0.25),
                   all: () => zoom(...whole)};
  const keys = {ArrowLeft: "left", ArrowRight: "right", "+": "in", "=": "in", "-": "out", "0": "all", Escape: "all"};

  // The empty panel; `fill` draws into it once it has its place in the page
  function frame(panel) {
    const box = document.createElement("div"), place = document.createElement("div");
    const heading = document.createElement("h4"), axisName = document.createElement("small");
    box.className = "panel";
    place.className = "plot";
    place.tabIndex = 0;
    place.setAttribute("role", "img");
    place.setAttribute("aria-label", `${panel.title}, ${panel.axis} over time: ${panel.curves.map(c => c.label).join(", ")}`);
    axisName.textContent = panel.title.endsWith(panel.axis) ? "" : panel.axis;
    heading.append(`${panel.title} `, axisName);
    box.append(heading, place);
    place.style.height = `${HEIGHT}px`;
    const [begin, end] = ends(panel.time);
    whole = [Math.min(whole[0], begin), Math.max(whole[1], end)];
    return {box, place, panel};
  }

  function fill({box, place, panel}) {
    place.style.height = "";
    const single = panel.curves.length === 1;
    panel.curves.forEach((curve, k) => { curve.colour = single ? 2 : k % 6 + 1; });
    const axis = {stroke: () => colour("faint"), grid: {stroke: () => colour("line"), width: 1},
                  ticks: {stroke: () => colour("line"), width: 1}, font: "12px system-ui, sans-serif",
                  values: (_, splits) => splits.map(v => String(+v.toPrecision(6)))};
    let values = [];
    const chart = new uPlot({
      width: place.clientWidth, height: HEIGHT, legend: {show: false}, padding: [10, 10, 0, 0],
      scales: {x: {time: false}},
      axes: [{...axis, size: 28, space: 45, label: "time in s", labelSize: 18, labelFont: "12px system-ui, sans-serif"}, {...axis, size: (u, texts) => 20 + 7.5 * Math.max(2, ...(texts ?? []).map(t => t.length))}],
      cursor: {sync: {key: group.key, filters: {pub: type => type === "mousemove" || type === "mouseleave"}},
               drag: {x: true, y: false}, points: {size: 7}},
      series: [{}, ...panel.curves.map(curve => ({
        label: curve.label, stroke: () => colour(`curve-${curve.colour}`) + (curve.below ? "73" : ""),
        width: curve.below ? 5 : 1.4, spanGaps: true, points: {show: false}}))],
      hooks: {
        setScale: [(u, key) => { if (key === "x" && !zooming && shown) zoom(u.scales.x.min, u.scales.x.max); }],
        setCursor: [u => values.forEach((value, k) => {
          const row = u.cursor.idxs[k + 1], v = row == null ? null : u.data[k + 1][row];
          value.textContent = v == null ? "" : `${short(v)} ${panel.unit}`;
        })],
      },
    }, [read(panel.time), ...panel.curves.map(curve => read(curve.values))], place);
    const names = legend(panel, chart);
    values = names.values;
    box.append(names.list);

    const now = document.createElement("div");
    now.className = "now";
    now.hidden = true;
    chart.over.append(now);
    const mark = t => {
      now.hidden = t === null || t < chart.scales.x.min || t > chart.scales.x.max;
      if (!now.hidden) now.style.transform = `translateX(${chart.valToPos(t, "x") - 1}px)`;
    };
    chart.hooks.draw = [() => mark(marked)];
    zooming = true;
    chart.setScale("x", {min: shown[0], max: shown[1]});
    zooming = false;
    place.addEventListener("keydown", event => {
      const action = event.ctrlKey || event.metaKey || event.altKey ? undefined : keys[event.key];
      if (action) { actions[action](); event.preventDefault(); }
    });
    chart.over.addEventListener("dblclick", () => actions.all());
    const resize = width => { if (width && width !== chart.width) chart.setSize({width, height: HEIGHT}); };
    new ResizeObserver(() => resize(place.clientWidth)).observe(place);
    addEventListener("beforeprint", () => resize(PRINTED));
    addEventListener("afterprint", () => resize(place.clientWidth));
    themed.push(() => chart.redraw(false));
    plots.push({chart, mark});
  }

  const groups = [...document.querySelectorAll("[data-group]")].map(place => {
    const {title, panels} = data.groups[place.dataset.group], frames = panels.map(frame);
    place.append(...frames.map(f => f.box));
    return {fold: place.closest("details"), title, frames};
  });
  const waiting = new Map(groups.flatMap(group => group.frames.map(f => [f.box, f])));
  const near = [];   // boxes to fill: those that came near last are first
  const fillBox = box => {
    const found = waiting.get(box);
    if (found && waiting.delete(box)) fill(found);
  };
  // One plot at a time, so that the page is there at once and answers meanwhile
  const fillNext = () => {
    if (near.length) {
      fillBox(near.shift());
      setTimeout(fillNext);
    }
  };
  const approach = boxes => {
    const idle = !near.length;
    near.unshift(...boxes);
    if (idle) setTimeout(fillNext);
  };
  const many = waiting.size > FEW;
  if (waiting.size) {
    zoom(...whole);
    const watch = new IntersectionObserver(entries => approach(entries.filter(e => e.isIntersecting).map(e => e.target)),
                                           {rootMargin: "50%"});
    if (many) waiting.forEach((_, box) => watch.observe(box));
    else approach(waiting.keys());
  }
  let folded = [];   // groups that are open on paper only
  addEventListener("beforeprint", () => {
    folded = groups.filter(group => !group.fold.open);
    folded.forEach(group => { group.fold.open = true; });
    [...waiting.keys()].forEach(fillBox);
  });
  addEventListener("afterprint", () => folded.splice(0).forEach(group => { group.fold.open = false; }));

  const filter = document.getElementById("filter"), found = document.getElementById("found");
  filter.closest("label").hidden = !many;
  filter.addEventListener("input", () => {
    const words = filter.value.toLowerCase().split(/\s+/).filter(Boolean);
    let count = 0;
    for (const {fold, title, frames} of groups) {
      const shownFrames = frames.filter(({box, panel}) => {
        const text = [title, panel.title, panel.axis, ...panel.curves.map(c => c.label)].join(" ").toLowerCase();
        const matches = words.every(word => text.includes(word));
        box.hidden = !matches;
        return matches;
      });
      count += shownFrames.length;
      fold.hidden = words.length > 0 && !shownFrames.length;
      if (words.length && shownFrames.length) fold.open = true;
    }
    found.textContent = words.length ? `${count} of ${groups.reduce((n, g) => n + g.frames.length, 0)}` : "";
  });
  document.querySelectorAll("[data-zoom]").forEach(
    button => button.addEventListener("click", actions[button.dataset.zoom]));
  document.querySelectorAll("[data-window]").forEach(
    button => button.addEventListener("click", () => zoom(...button.dataset.window.split(" ").map(Number))));
  for (const input of [first, last]) {
    input.addEventListener("change", () => {
      const low = parseFloat(first.value), high = parseFloat(last.value);
      if (low < high) zoom(low, high);
      else [first.value, last.value] = shown.map(short);
    });
  }
}
