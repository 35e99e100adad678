// The names below a plot, which switch its curves; numbers of the data as uPlot takes them.

const short = v => String(+v.toPrecision(5));
const read = text => Array.from(new Float32Array(bytes(text)), v => Number.isFinite(v) ? v : null);

// The first and the last number, decoding no more than these.
function ends(text) {
  const tail = new Uint8Array(bytes(text.slice(-8))), last = tail.slice(tail.length - 4);
  return [new Float32Array(bytes(text.slice(0, 8)).slice(0, 4))[0], new Float32Array(last.buffer)[0]];
}

function legend(panel, chart) {
  const list = document.createElement("ul");
  list.className = "curves";
  const values = panel.curves.map((curve, k) => {
    const item = document.createElement("li"), button = document.createElement("button");
    const marker = document.createElement("span"), value = document.createElement("span");
    marker.className = "marker";
    marker.style.borderColor = `var(--curve-${curve.colour})`;
    value.className = "value";
    button.type = "button";
    button.setAttribute("aria-pressed", "true");
    button.append(marker, curve.label, value);
    button.addEventListener("click", () => {
      const on = button.getAttribute("aria-pressed") !== "true";
      button.setAttribute("aria-pressed", on);
      chart.setSeries(k + 1, {show: on});
    });
    item.append(button);
    list.append(item);
    return value;
  });
  return {list, values};
}
