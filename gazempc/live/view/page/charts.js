// Drawings: the scene from above, the robot's view, and lines over time.

const CONTACT_DEG = 2.6;
const VIEW_DEG = 15;
const HISTORY_S = 30;

function prepared(canvas) {
  const ratio = window.devicePixelRatio || 1;
  const width = canvas.clientWidth, height = canvas.clientHeight;
  if (canvas.width !== Math.round(width * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  const style = getComputedStyle(document.documentElement);
  const colour = (name) => style.getPropertyValue(`--${name}`).trim();
  return { context, width, height, colour };
}

function dot(context, x, y, radius, colour) {
  context.fillStyle = colour;
  context.beginPath();
  context.arc(x, y, radius, 0, 2 * Math.PI);
  context.fill();
}

function path(context, points, colour, width = 2) {
  context.strokeStyle = colour;
  context.lineWidth = width;
  context.beginPath();
  points.forEach(([x, y], k) => (k ? context.lineTo(x, y) : context.moveTo(x, y)));
  context.stroke();
}

// The robot is at the bottom and looks up: x up, y to the left. The range only grows, for a steady scale.
let reachM = 3;
export function drawAbove(canvas, state) {
  const { context, width, height, colour } = prepared(canvas);
  const head = state.true_m || state.observed_m;
  if (head) reachM = Math.max(reachM, Math.min(12, Math.hypot(head[0], head[1]) * 1.15));
  const behind = 0.12;
  const scale = Math.min((height * (1 - behind)) / reachM, width / 2 / reachM);
  const at = ([x, y]) => [width / 2 - y * scale, height * (1 - behind) - x * scale];
  for (let m = -Math.ceil(reachM); m <= Math.ceil(reachM); m += 1) {
    path(context, [at([-reachM, m]), at([2 * reachM, m])], colour("rule"), 0.5);
    path(context, [at([m, -2 * reachM]), at([m, 2 * reachM])], colour("rule"), 0.5);
  }
  state.forecast_m.forEach((mean, k) => {
    const ellipse = state.ellipses[k];
    if (!ellipse) return;
    const [x, y] = at(mean);
    context.save();
    context.translate(x, y);
    // Pixels: right is -y, down is -x; so a direction of t turns to -(t + 90 deg).
    context.rotate(-(ellipse[2] + Math.PI / 2));
    context.beginPath();
    context.ellipse(0, 0, Math.min(ellipse[0], 50) * scale, Math.min(ellipse[1], 50) * scale, 0, 0, 2 * Math.PI);
    context.globalAlpha = 0.2;
    context.fillStyle = colour("forecast");
    context.fill();
    context.restore();
  });
  if (state.forecast_m.length) {
    path(context, [state.observed_m, ...state.forecast_m].map(at), colour("forecast"));
  }
  const far = 2 * reachM;
  const end = [state.eye_m[0] + far * state.gaze[0], state.eye_m[1] + far * state.gaze[1]];
  path(context, [at(state.eye_m), at(end)], colour("gaze"));
  dot(context, ...at([0, 0]), 7, colour("ink"));
  if (state.true_m) dot(context, ...at(state.true_m), Math.max(5, 0.1 * scale), colour("true"));
  if (state.observed_m) dot(context, ...at(state.observed_m), Math.max(3, 0.05 * scale), colour("seen"));
}

export function drawEye(canvas, state) {
  const { context, width, height, colour } = prepared(canvas);
  const scale = Math.min(width, height) / 2 / VIEW_DEG;
  const at = ([left, up]) => [width / 2 - left * scale, height / 2 - up * scale];
  context.strokeStyle = colour("rule");
  context.lineWidth = 0.5;
  for (const ring of [5, 10, 15]) {
    context.beginPath();
    context.arc(width / 2, height / 2, ring * scale, 0, 2 * Math.PI);
    context.stroke();
  }
  context.fillStyle = colour("faint");
  context.font = "11px system-ui, sans-serif";
  context.fillText("10 deg", width / 2 + 10 * scale + 3, height / 2 - 3);
  context.strokeStyle = colour("ink");
  context.lineWidth = 2;
  context.beginPath();
  context.arc(width / 2, height / 2, CONTACT_DEG * scale, 0, 2 * Math.PI);
  context.stroke();
  path(context, [at([-0.7, 0]), at([0.7, 0])], colour("gaze"));
  path(context, [at([0, -0.7]), at([0, 0.7])], colour("gaze"));
  if (!state.in_view_deg) return;
  const forecast = state.forecast_in_view_deg;
  if (forecast.length) path(context, [state.in_view_deg, ...forecast].map(at), colour("forecast"), 1.5);
  const [x, y] = at(state.in_view_deg);
  // A head outside of the picture is a hollow circle at its edge.
  const inside = [Math.min(Math.max(x, 8), width - 8), Math.min(Math.max(y, 8), height - 8)];
  const name = state.true_m ? "true" : "seen";
  if (inside[0] === x && inside[1] === y) {
    dot(context, x, y, 7, colour(name));
  } else {
    context.strokeStyle = colour(name);
    context.lineWidth = 2;
    context.beginPath();
    context.arc(...inside, 6, 0, 2 * Math.PI);
    context.stroke();
  }
}

// rows: [time, ...values]; lines: [column, colour, dashed]; a dashed line at `mark`. The scale ends between `least` and
// `cap`; larger values are clamped.
export function drawLines(canvas, rows, lines, events, mark, least, cap) {
  const { context, width, height, colour } = prepared(canvas);
  if (!rows.length) return;
  const now = rows[rows.length - 1][0];
  const left = 34, bottom = 16, top = 6;
  const values = rows.flatMap((row) => lines.map(([column]) => row[column])).filter((v) => v !== null);
  const most = Math.min(Math.max(least, ...values) * 1.05, cap);
  const x = (time) => left + ((time - now + HISTORY_S) / HISTORY_S) * (width - left - 6);
  const y = (value) => height - bottom - (Math.min(value, most) / most) * (height - bottom - top);
  context.font = "11px system-ui, sans-serif";
  context.fillStyle = colour("faint");
  const step = [0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000].find((each) => most / each <= 4) || most / 4;
  for (let value = 0; value <= most; value += step) {
    path(context, [[left, y(value)], [width - 6, y(value)]], colour("rule"), 0.5);
    context.textAlign = "right";
    context.fillText(String(value), left - 4, y(value) + 4);
  }
  context.textAlign = "center";
  for (const ago of [30, 20, 10, 0]) context.fillText(ago ? `-${ago} s` : "now", Math.min(Math.max(x(now - ago), left + 8), width - 16), height - 3);
  for (const event of events) {
    if (event.time_s > now - HISTORY_S) path(context, [[x(event.time_s), top], [x(event.time_s), height - bottom]], colour("seen"), 1);
  }
  if (mark) {
    context.setLineDash([5, 4]);
    path(context, [[left, y(mark)], [width - 6, y(mark)]], colour("ink"), 1);
    context.setLineDash([]);
  }
  for (const [column, name, dashed] of lines) {
    let run = [];
    context.setLineDash(dashed ? [2, 3] : []);
    for (const row of [...rows, [0]]) {
      if (typeof row[column] === "number") run.push([x(row[0]), y(row[column])]);
      else {
        if (run.length > 1) path(context, run, colour(name), 1.5);
        run = [];
      }
    }
    context.setLineDash([]);
  }
}
