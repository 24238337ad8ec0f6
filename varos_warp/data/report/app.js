"use strict";
// What the parts of the page share: the data, the frame that is shown, and who wants to know when it changes.
const DATA = JSON.parse(document.getElementById("data").textContent);
const $ = id => document.getElementById(id);
const state = { index: 0, camera: DATA.cameras[0] && DATA.cameras[0].id, playing: false, hover: null };
const listeners = [];  // called with the state after each change of it
const repaint = [];    // called when colours or sizes change

function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name in made) made[name] = value; else made.setAttribute(name, value);
  }
  made.append(...children);
  return made;
}

const color = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const time = index => DATA.times[index];

function show(index) {
  state.index = Math.max(0, Math.min(DATA.frames.length - 1, Math.round(index)));
  listeners.forEach(listener => listener(state));
}

function showTime(seconds) {  // the frame nearest to a time
  let best = 0;
  DATA.times.forEach((t, i) => { if (Math.abs(t - seconds) < Math.abs(time(best) - seconds)) best = i; });
  show(best);
}

// ------------------------------------------------------------------------------------------------------------- theme

function setTheme(dark) {
  document.documentElement.dataset.theme = dark ? "dark" : "light";
  repaint.forEach(draw => draw());
}
const preference = matchMedia("(prefers-color-scheme: dark)");
preference.addEventListener("change", event => setTheme(event.matches));
$("theme").onclick = () => setTheme(document.documentElement.dataset.theme !== "dark");

// ------------------------------------------------------------------------------------------------------------ images

const source = (output, index) => `data:image/webp;base64,${DATA.images[state.camera][output][index]}`;

function buildViewer() {
  const viewer = $("viewer");
  if (!viewer) return;
  for (const { letter, content } of DATA.outputs) {
    const picture = element("img", { alt: content, draggable: false });
    const caption = element("figcaption", {}, element("b", {}, letter), element("span", {}, content));
    const figure = element("figure", { title: content }, picture, caption);
    figure.dataset.output = letter;
    figure.onclick = () => { if (viewer.className === "focus") viewer.prepend(figure); };
    viewer.append(figure);
    listeners.push(({ index }) => { picture.src = source(letter, index); });
  }
  for (const button of document.querySelectorAll("[data-layout]")) {
    button.onclick = () => {
      viewer.className = button.dataset.layout;
      document.querySelectorAll("[data-layout]").forEach(b => b.setAttribute("aria-pressed", b === button));
    };
  }
}

function buildSheet() {
  const sheet = $("sheet");
  if (!sheet) return;
  const columns = Math.min(DATA.frames.length, innerWidth < 760 ? 4 : 8);
  sheet.style.setProperty("--columns", Math.max(columns, 4));
  const picks = Array.from({ length: columns }, (_, i) => Math.round(i * (DATA.frames.length - 1) / Math.max(1, columns - 1)));
  let shown = null;
  const fill = () => {
    sheet.replaceChildren();
    for (const { letter } of DATA.outputs) for (const index of picks) {
      const picture = element("img", { src: source(letter, index), alt: "", loading: "lazy" });
      const button = element("button", { type: "button", onclick: () => show(index) }, picture,
                             element("span", {}, `${letter} ${DATA.frames[index]}`));
      button.dataset.index = index;
      sheet.append(button);
    }
    shown = state.camera;
  };
  listeners.push(({ index }) => {
    if (shown !== state.camera) fill();
    for (const button of sheet.children) button.classList.toggle("now", +button.dataset.index === index);
  });
}

// -------------------------------------------------------------------------------------------------------------- time

const SPEEDS = [0.25, 0.5, 1, 2, 4, 8, 16, 32, 64];

function buildTransport() {
  const scrubber = $("scrubber"), last = DATA.frames.length - 1;
  if (!scrubber) return;
  scrubber.max = last;
  scrubber.oninput = () => show(+scrubber.value);
  $("back").onclick = () => show(state.index - 1);
  $("next").onclick = () => show(state.index + 1);
  $("play").onclick = () => play(!state.playing);
  for (const speed of SPEEDS) $("speed").append(element("option", { value: speed }, `${speed} ×`));
  const length = last > 0 ? time(last) - time(0) : 0;
  $("speed").value = SPEEDS.find(speed => speed >= 1 && length / speed <= 45) || 64;
  for (const { id } of DATA.cameras) $("camera").append(element("option", { value: id }, id));
  $("camera").onchange = () => { state.camera = $("camera").value; show(state.index); };
  $("camera-choice").hidden = DATA.cameras.length < 2;
  const motion = DATA.plots.find(plot => plot.title === "Speed");
  listeners.push(({ index }) => {
    scrubber.value = index;
    const speed = motion ? ` · ${motion.at_frames[0][index].toFixed(2)} m/s` : "";
    $("clock").textContent = `frame ${DATA.frames[index]} · ${time(index).toFixed(2)} s${speed}`;
    scrubber.setAttribute("aria-valuetext", $("clock").textContent);
  });
}

function play(on) {
  if (!$("play")) return;
  state.playing = on && DATA.frames.length > 1;
  $("play").textContent = state.playing ? "❚❚" : "▶";
  $("play").setAttribute("aria-label", state.playing ? "Pause" : "Play");
  if (!state.playing) return;
  if (state.index === DATA.frames.length - 1) show(0);
  let clock = time(state.index), before = performance.now(), shown = state.index;
  const tick = now => {
    if (!state.playing) return;
    if (state.index !== shown) clock = time(state.index);  // somebody moved the scrubber
    clock += (now - before) / 1000 * +$("speed").value;
    before = now;
    let index = state.index;
    while (index < DATA.frames.length - 1 && time(index + 1) <= clock) index += 1;
    if (index !== state.index) show(index);
    shown = state.index;
    if (index === DATA.frames.length - 1) play(false); else requestAnimationFrame(tick);
  };
  requestAnimationFrame(tick);
}

const KEYS = {
  ArrowLeft: event => show(state.index - (event.shiftKey ? 10 : 1)), ArrowRight: event => show(state.index + (event.shiftKey ? 10 : 1)),
  Home: () => show(0), End: () => show(DATA.frames.length - 1), " ": () => play(!state.playing),
};
addEventListener("keydown", event => {
  const typing = ["SELECT", "TEXTAREA", "SUMMARY"].includes(event.target.tagName) || (event.target.tagName === "BUTTON" && event.key === " ");
  if (!KEYS[event.key] || typing || event.ctrlKey || event.metaKey || event.altKey) return;
  event.preventDefault();
  KEYS[event.key](event);
});
