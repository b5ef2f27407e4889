// Shows the state of the run from server-sent events, with reconnection.

import { drawAbove, drawEye, drawLines } from "./charts.js";

const HISTORY = 600;
const AGAIN_MS = 500;
const STALE_MS = 2000;

const at = (id) => document.getElementById(id);
const text = (id, value) => { if (at(id).textContent !== value) at(id).textContent = value; };
const number = (value, digits, unit) => (value === null || value === undefined ? "unknown" : `${value.toFixed(digits)} ${unit}`);

let state = null;
let rows = [];
let over = false;
let heard = 0;
let lastEvent = 0;
let pictureAt = 0;
let source = null;

function connection(words, lost) {
  text("connection", words);
  at("connection").classList.toggle("lost", lost);
}

function connect() {
  source = new EventSource("state");
  source.addEventListener("hello", (message) => {
    const hello = JSON.parse(message.data);
    const about = hello.about;
    text("recording", about.recording);
    text("about", `${about.controller} with ${about.predictor}, neck ${about.neck}, robot ${about.robot}`);
    text("against", `against ${about.scored_against}; dashed: 2.6 deg`);
    rows = hello.history;
    over = false;
    lastEvent = 0;
    at("events").replaceChildren();
    heard = Date.now();
    connection("connected; waiting for the run", false);
  });
  source.addEventListener("state", (message) => {
    state = JSON.parse(message.data);
    heard = Date.now();
    rows.push([state.time_s, state.error_deg, state.latency_ms, state.late_ms]);
    if (rows.length > HISTORY) rows.shift();
    connection("live", false);
  });
  source.addEventListener("end", () => {
    over = true;
    connection("the run is over; the last state is shown", false);
  });
  source.onerror = () => {
    if (!over) connection("connection lost; trying again", true);
    // The browser reconnects by itself, unless the source is closed.
    if (source.readyState === EventSource.CLOSED) setTimeout(connect, AGAIN_MS);
  };
}

function showNumbers() {
  const age = state.age_s;
  const where = number(state.distance_m, 2, "m");
  text("person", age === null ? "not seen yet" : age > 1 ? `lost for ${age.toFixed(1)} s` : `${where} away, seen ${Math.round(1000 * age)} ms ago`);
  text("error", number(state.error_deg, 2, "deg"));
  text("latency", number(state.latency_ms, 0, "ms"));
  text("late", `${number(state.late_ms, 2, "ms")}; ${state.skipped_ticks} skipped`);
  text("joints", Object.entries(state.joints_deg).map(([name, deg]) => `${name.replace("_", " ")} ${deg.toFixed(1)}°`).join(", "));
  text("time", number(state.time_s, 1, "s"));
}

function showEvents() {
  for (const event of state.events) {
    if (event.id <= lastEvent) continue;
    lastEvent = event.id;
    at("events").querySelector(".none")?.remove();
    const line = document.createElement("li");
    line.textContent = `${event.time_s.toFixed(1)} s  ${event.text}`;
    at("events").prepend(line);
    while (at("events").childElementCount > 50) at("events").lastElementChild.remove();
  }
  if (!at("events").childElementCount) at("events").innerHTML = '<li class="none">none yet</li>';
}

function showPicture() {
  at("camera").hidden = !state.has_picture;
  if (state.has_picture && Date.now() - pictureAt > 200 && !over) {
    pictureAt = Date.now();
    at("picture").src = `picture.jpg?${pictureAt}`;
  }
}

function draw() {
  if (state) {
    showNumbers();
    showEvents();
    showPicture();
    drawAbove(at("above"), state);
    drawEye(at("eye"), state);
    drawLines(at("errors"), rows, [[1, "forecast"]], state.events, 2.6, 5, 15);
    drawLines(at("times"), rows, [[2, "forecast"], [3, "gaze", true]], [], 0, 10, 250);
    if (!over && Date.now() - heard > STALE_MS) connection("no data from the run", true);
  }
}

connect();
setInterval(draw, 50);
