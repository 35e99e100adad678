// A click on a point of the front shows its response and its section of a scenario.

{
  const place = document.getElementById("responses"), title = document.getElementById("response-title");
  const sections = document.getElementById("sections").content.children, toml = document.getElementById("toml");
  const points = [...document.querySelectorAll("[data-point]")];
  const names = [...document.querySelectorAll("button[data-point]")].map(button => button.textContent);
  let drawn = [];

  function show(number) {
    drawn.splice(0).forEach(remove => remove());
    drawn = data.responses[number].map(chart => drawChart(place, chart));
    title.textContent = `Response: ${names[number]}`;
    toml.textContent = sections[number].textContent;
    toml.hidden = !toml.textContent;
    points.forEach(point => point.setAttribute("aria-pressed", Number(point.dataset.point) === number));
  }

  for (const point of points) {
    const number = Number(point.dataset.point);
    point.addEventListener("click", () => show(number));
    if (point.tagName !== "BUTTON") {
      point.addEventListener("keydown", event => {
        if (event.key === "Enter" || event.key === " ") { show(number); event.preventDefault(); }
      });
    }
  }
  show(data.chosen);
}
