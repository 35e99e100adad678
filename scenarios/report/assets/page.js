"use strict";
// Light and dark, and the data that the page carries.

const data = JSON.parse(document.getElementById("data").textContent);
const themed = [];   // functions that draw again in the colours of the theme

const palette = {};  // the colours of page.css, read once for each theme
const colour = name => palette[name] ??= getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

function bytes(text) {
  const raw = atob(text), found = new Uint8Array(raw.length);
  for (let k = 0; k < raw.length; k++) found[k] = raw.charCodeAt(k);
  return found.buffer;
}

{
  const root = document.documentElement;
  const button = document.getElementById("theme");
  const preference = matchMedia("(prefers-color-scheme: dark)");
  let chosen = null;
  const show = dark => {
    root.dataset.theme = dark ? "dark" : "light";
    button.textContent = dark ? "Light theme" : "Dark theme";
    Object.keys(palette).forEach(name => delete palette[name]);
    themed.forEach(draw => draw());
  };
  const current = () => chosen ?? preference.matches;
  button.addEventListener("click", () => show(chosen = !current()));
  preference.addEventListener("change", () => show(current()));
  addEventListener("beforeprint", () => show(false));
  addEventListener("afterprint", () => show(current()));
  show(current());
}
