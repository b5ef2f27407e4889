"use strict";
// Charts with cursor and zoom: each figure has its data as JSON, and its legend as buttons.
for (const figure of document.querySelectorAll("figure.chart")) {
  const data = JSON.parse(figure.querySelector("script").textContent);
  const svg = figure.querySelector("svg");
  const buttons = [...figure.querySelectorAll("button")];
  const at = figure.querySelector(".at");
  const [height, left, right, top, bottom] = [360, 62, 14, 12, 48];
  let width = 900;
  const all = data.curves.flatMap((curve) => [curve.xs[0], curve.xs[curve.xs.length - 1]]).filter(Number.isFinite);
  const whole = all.length ? [Math.min(...all), Math.max(...all)] : [0, 1];
  // Charts of few points have markers, and a margin.
  const few = data.curves.every((curve) => curve.xs.length <= 200 && data.spans.length === 0);
  const margin = whole[0] === whole[1] ? 0.5 : few ? 0.03 * (whole[1] - whole[0]) : 0;
  whole[0] -= margin;
  whole[1] += margin;
  let shown = [...whole];
  let scale = null;
  let dragged = null;

  const element = (name, attributes, parent = svg) => {
    const made = document.createElementNS(svg.namespaceURI, name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    parent.append(made);
    return made;
  };
  const text = (words, x, y, anchor, more = {}) =>
    (element("text", { x, y, "text-anchor": anchor, ...more }).textContent = words);
  const short = (value) => String(+value.toPrecision(4));

  const ticks = ([low, high], count) => {
    const raw = (high - low) / count;
    const power = 10 ** Math.floor(Math.log10(raw));
    const step = power * [1, 2, 5, 10].find((factor) => factor * power >= raw);
    const found = [];
    for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) found.push(+(k * step).toPrecision(12));
    return found;
  };

  const isOn = (i) => buttons[i].getAttribute("aria-pressed") === "true";

  const heights = () => {
    let [low, high] = [Infinity, -Infinity];
    data.curves.forEach((curve, i) => {
      if (!isOn(i)) return;
      curve.xs.forEach((x, k) => {
        const y = curve.ys[k];
        if (y === null || x < shown[0] || x > shown[1]) return;
        low = Math.min(low, y);
        high = Math.max(high, y);
      });
    });
    if (low > high) [low, high] = [0, 1];
    // The scale of positive quantities, such as errors, starts at zero.
    if (low >= 0) low = Math.min(low, 0);
    const margin = 0.05 * (high - low) || 1;
    return [low === 0 ? 0 : low - margin, high + margin];
  };

  const draw = () => {
    // The font size is independent of the screen width.
    width = Math.max(svg.clientWidth, 280);
    svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    svg.replaceChildren();
    const [low, high] = heights();
    const toX = (x) => left + ((x - shown[0]) / (shown[1] - shown[0])) * (width - left - right);
    const toY = (y) => height - bottom - ((y - low) / (high - low)) * (height - top - bottom);
    scale = { toX, toY, fromX: (px) => shown[0] + ((px - left) / (width - left - right)) * (shown[1] - shown[0]) };
    const clip = `clip-${[...document.querySelectorAll("figure.chart")].indexOf(figure)}`;
    const box = { x: left, y: top, width: width - left - right, height: height - top - bottom };
    element("rect", box, element("clipPath", { id: clip }));
    const bar = 18;
    const lower = data.spans.some((span) => span.colour) ? bar : 0;
    for (const span of data.spans) {
      const [from, to] = [Math.max(toX(span.start), left), Math.min(toX(span.end), width - right)];
      if (to <= from) continue;
      const room = span.colour
        ? { y: top, height: bar, style: `fill: ${span.colour}` }
        : { y: top + lower, height: box.height - lower, class: "shade" };
      element("rect", { ...room, x: from, width: to - from });
      // A letter is some 7 pixels wide.
      if (to - from < 7 * span.name.length + 12) continue;
      const look = span.colour ? { style: "fill: #1b1b1b" } : {};
      text(span.name, from + 6, (span.colour ? top : top + lower) + (span.colour ? 13 : 16), "start", look);
    }
    for (const x of ticks(shown, width / 110)) {
      element("line", { x1: toX(x), x2: toX(x), y1: top, y2: height - bottom, class: "grid" });
      text(short(x), toX(x), height - bottom + 18, "middle");
    }
    for (const y of ticks([low, high], 5)) {
      element("line", { x1: left, x2: width - right, y1: toY(y), y2: toY(y), class: "grid" });
      text(short(y), left - 8, toY(y) + 4, "end");
    }
    for (const [y, name] of data.levels) {
      if (y < low || y > high) continue;
      element("line", { x1: left, x2: width - right, y1: toY(y), y2: toY(y), class: "level" });
      text(name, width - right - 4, toY(y) - 4, "end", { class: "level" });
    }
    text(data.x, (left + width - right) / 2, height - 8, "middle");
    const middle = (top + height - bottom) / 2;
    text(data.y, 0, 0, "middle", { transform: `translate(15 ${middle}) rotate(-90)` });
    const inside = element("g", { "clip-path": `url(#${clip})` });
    data.curves.forEach((curve, i) => {
      if (!isOn(i)) return;
      let pen = "M";
      let d = "";
      curve.xs.forEach((x, k) => {
        if (curve.ys[k] === null) return (pen = "M");
        // An isolated point is a line of zero length with visible round ends.
        const alone = pen === "M" && (curve.ys[k + 1] ?? null) === null;
        d += `${pen}${toX(x).toFixed(1)} ${toY(curve.ys[k]).toFixed(1)}${alone ? "h0" : ""}`;
        pen = "L";
      });
      const colour = buttons[i].style.getPropertyValue("--curve");
      element("path", { d, class: "curve", "stroke-dasharray": curve.dash, style: `--curve: ${colour}` }, inside);
      if (!few) return;
      curve.xs.forEach((x, k) => {
        if (curve.ys[k] === null) return;
        const [cx, cy] = [toX(x).toFixed(1), toY(curve.ys[k]).toFixed(1)];
        element("circle", { cx, cy, r: 3, class: "mark", style: `--curve: ${colour}` }, inside);
      });
    });
    figure.dataset.from = short(shown[0]);
    figure.dataset.to = short(shown[1]);
  };

  const place = (event) => {
    const bounds = svg.getBoundingClientRect();
    const px = ((event.clientX - bounds.left) / bounds.width) * width;
    return Math.min(Math.max(scale.fromX(px), shown[0]), shown[1]);
  };

  const nearest = (xs, x) => {
    let [low, high] = [0, xs.length - 1];
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (xs[middle] < x) low = middle;
      else high = middle;
    }
    return x - xs[low] < xs[high] - x ? low : high;
  };

  const read = (x) => {
    svg.querySelectorAll(".cursor").forEach((old) => old.remove());
    at.textContent = x === null ? "" : `at ${short(x)}`;
    if (x !== null) {
      element("line", { x1: scale.toX(x), x2: scale.toX(x), y1: top, y2: height - bottom, class: "cursor" });
    }
    data.curves.forEach((curve, i) => {
      const k = x === null || !curve.xs.length ? -1 : nearest(curve.xs, x);
      const value = k < 0 ? null : curve.ys[k];
      const name = k >= 0 && curve.names ? ` ${curve.names[k]} (${short(curve.xs[k])})` : "";
      buttons[i].querySelector("output").textContent = value === null ? (x === null ? "" : "–") : short(value) + name;
    });
  };

  const zoom = (from, to) => {
    const least = (whole[1] - whole[0]) / 1000;
    const span = Math.min(Math.max(to - from, least), whole[1] - whole[0]);
    const start = Math.min(Math.max(from, whole[0]), whole[1] - span);
    shown = [start, start + span];
    read(null);
    draw();
  };

  svg.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    dragged = place(event);
    svg.setPointerCapture(event.pointerId);
  });
  svg.addEventListener("pointermove", (event) => {
    const x = place(event);
    read(x);
    svg.querySelectorAll(".drag").forEach((old) => old.remove());
    if (dragged === null) return;
    const ends = [scale.toX(dragged), scale.toX(x)].sort((a, b) => a - b);
    const box = { x: ends[0], width: ends[1] - ends[0], y: top, height: height - top - bottom };
    element("rect", { ...box, class: "drag" });
  });
  svg.addEventListener("pointerup", (event) => {
    const ends = [dragged, place(event)];
    svg.querySelectorAll(".drag").forEach((old) => old.remove());
    if (dragged !== null && Math.abs(scale.toX(ends[1]) - scale.toX(ends[0])) > 8) zoom(Math.min(...ends), Math.max(...ends));
    dragged = null;
  });
  svg.addEventListener("pointercancel", () => (dragged = null));
  svg.addEventListener("pointerleave", () => read(null));
  svg.addEventListener("dblclick", () => zoom(...whole));
  figure.addEventListener("keydown", (event) => {
    const [middle, half] = [(shown[0] + shown[1]) / 2, (shown[1] - shown[0]) / 2];
    const moves = {
      "+": [middle - half / 2, middle + half / 2],
      "-": [middle - 2 * half, middle + 2 * half],
      ArrowLeft: [shown[0] - half / 2, shown[1] - half / 2],
      ArrowRight: [shown[0] + half / 2, shown[1] + half / 2],
      Home: whole,
    };
    if (!(event.key in moves) || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    zoom(...moves[event.key]);
  });
  buttons.forEach((button) =>
    button.addEventListener("click", () => {
      button.setAttribute("aria-pressed", button.getAttribute("aria-pressed") === "true" ? "false" : "true");
      draw();
    }),
  );
  new ResizeObserver(() => svg.clientWidth !== width && draw()).observe(svg);
  draw();
}
// Details are unfolded for print.
const folded = () => document.querySelectorAll("details:not([open])");
let opened = [];
addEventListener("beforeprint", () => {
  opened = [...folded()];
  opened.forEach((each) => (each.open = true));
});
addEventListener("afterprint", () => opened.forEach((each) => (each.open = false)));
