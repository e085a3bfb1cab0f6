// What lies over the field: landmarks, the place that was asked for, routes with their ellipses.

import { significant } from "./format.js";

export const CHOSEN = "#005ce6";
export const SHORTEST = "#d64f0c";
const LANDMARK = "#d62728";
const PALE = "#e3a9a9";
const INK = "#20242a";
const OUTLYING = "#e07000"; // fixes outside the ellipse
const PLACE = "#c8008c";
const ENLARGEMENTS = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000];
const CLEAR_PX = 13; // semi-axis at which an ellipse along a route is seen well
const SPACING_PX = 34; // between ellipses along a route
const MOST_PX = 46; // of a drawn semi-axis: larger ones would cover the map, and are drawn smaller and dashed
const NAMES_FROM_PX = 26; // per landmark and side, on the average: closer, names would cover each other

// statuses: by id, at the place that is inspected; those that cannot be measured there are pale.
export function landmarks(context, view, marks, selected, used, statuses) {
  const [x0, y0, x1, y1] = view.window(0.05);
  const seen = marks
    .map((mark, index) => ({ mark, index }))
    .filter(({ mark }) => mark.x_m >= x0 && mark.x_m <= x1 && mark.y_m >= y0 && mark.y_m <= y1);
  const isNamed = seen.length * NAMES_FROM_PX ** 2 * 6 < view.width * view.height;
  context.font = "11px system-ui, sans-serif";
  for (const { mark, index } of seen) {
    const [x, y] = view.toScreen({ x: mark.x_m, y: mark.y_m });
    const isUsed = used.includes(mark.id);
    const radius = index === selected ? 7 : isUsed ? 5.5 : 4;
    if (mark.facing_rad !== null) {
      line(context, [x, y], [x + 2.6 * radius * Math.cos(mark.facing_rad), y - 2.6 * radius * Math.sin(mark.facing_rad)], LANDMARK, 2);
    }
    const isPale = !isUsed && (statuses.get(mark.id) ?? "measurable") !== "measurable";
    disc(context, x, y, radius, index === selected ? PLACE : isPale ? PALE : LANDMARK);
    if (isNamed || isUsed || index === selected) {
      const right = x + radius + 3;
      const wide = context.measureText(mark.id).width;
      label(context, right + wide < view.width ? right : x - radius - 3 - wide, y - radius - 1, mark.id);
    }
  }
}

// The ellipse may be smaller than a pixel: it is drawn larger by a round factor, which is said beside the map.
export function enlargement(axes, scale, clear = CLEAR_PX) {
  const typical = axes.sort((a, b) => a - b)[Math.floor(axes.length / 2)];
  if (!typical) return 1;
  return ENLARGEMENTS.find((factor) => typical * factor * scale >= clear) ?? ENLARGEMENTS.at(-1);
}

// True where the ellipse is larger than it is drawn.
export function ellipse(context, view, p, shape, factor, color, largest = MOST_PX) {
  const [x, y] = view.toScreen(p);
  const most = view.scale * shape.a_m <= largest ? largest : Infinity; // large without help: as it is
  const scale = Math.min(factor * view.scale, most / shape.a_m);
  const isCut = scale < factor * view.scale * 0.999;
  context.save();
  context.beginPath();
  context.ellipse(x, y, shape.a_m * scale, shape.b_m * scale, -shape.theta_rad, 0, 2 * Math.PI);
  context.fillStyle = `${color}2e`;
  context.fill();
  if (isCut) context.setLineDash([3, 3]);
  context.strokeStyle = color;
  context.lineWidth = 1.5;
  context.stroke();
  context.restore();
  return isCut;
}

// A place that was asked for: its ellipse, the triplet's sight lines, a camera's view, the circle of danger.
export function point(context, view, { place, answer, triplet, marks, field, cloud, factor }) {
  const ellipse95 = triplet?.ellipse95 ?? answer?.ellipse95;
  const names = triplet?.triplet ?? answer?.triplet ?? [];
  const pan = triplet ? triplet.pan_rad : answer?.pan_rad;
  const sensor = field?.sensor;
  const heading = answer?.heading_rad ?? field?.heading_rad ?? 0;
  const eye = sensor ? mounted(place, heading, sensor.mount) : place;
  const at = names.map((name) => marks.find((mark) => mark.id === name)).filter(Boolean);
  if (sensor?.fov_rad && answer?.ellipse95) {
    const axis = heading + sensor.mount.theta_rad + (pan ?? 0);
    const far = at.map((mark) => Math.hypot(mark.x_m - eye.x, mark.y_m - eye.y));
    cone(context, view, eye, axis, sensor.fov_rad, Math.min(sensor.max_range_m ?? 1e9, 1.08 * Math.max(1, ...far)));
  }
  for (const mark of at) {
    const ends = [view.toScreen(eye), view.toScreen({ x: mark.x_m, y: mark.y_m })];
    line(context, ...ends, "#ffffff", 4);
    context.setLineDash(triplet?.blocking?.[mark.id] ? [3, 5] : []);
    line(context, ...ends, PLACE, 1.8);
    context.setLineDash([]);
  }
  if (answer?.state === "no_fix" && !triplet) seen(context, view, eye, answer.ranking?.landmarks ?? []);
  if ((triplet ?? answer)?.valid === false && at.length === 3) danger(context, view, at);
  if (cloud?.cloud) fixes(context, view, place, cloud, factor);
  if (ellipse95) ellipse(context, view, place, ellipse95, factor, PLACE, Infinity);
  if (answer?.headings) arrow(context, view, place, heading);
  const [x, y] = view.toScreen(place);
  disc(context, x, y, 3, PLACE);
}

// Where there is no fix: the landmarks that can be measured all the same.
function seen(context, view, eye, marks) {
  for (const mark of marks.filter(({ status }) => status === "measurable")) {
    line(context, view.toScreen(eye), view.toScreen({ x: mark.x_m, y: mark.y_m }), PLACE, 1);
  }
}

// Errors of simulated fixes around the place, enlarged as its ellipse is.
function fixes(context, view, place, { cloud, pose }, factor) {
  const [x, y] = view.toScreen(place);
  const scale = factor * view.scale;
  cloud.x_m.forEach((at, k) => {
    context.fillStyle = cloud.inside[k] ? "rgba(32, 36, 42, 0.55)" : OUTLYING;
    context.fillRect(x + (at - pose.x_m) * scale - 1, y - (cloud.y_m[k] - pose.y_m) * scale - 1, 2, 2);
  });
}

function arrow(context, view, place, heading) {
  const [x, y] = view.toScreen(place);
  const tip = (length, turn = 0) => [x + length * Math.cos(heading + turn), y - length * Math.sin(heading + turn)];
  for (const [color, width] of [["#ffffff", 5], [INK, 2]]) {
    polyline(context, [[x, y], tip(30)], color, width);
    polyline(context, [tip(23, 0.22), tip(30), tip(23, -0.22)], color, width);
  }
}

function mounted(place, heading, mount) {
  const [c, s] = [Math.cos(heading), Math.sin(heading)];
  return { x: place.x + c * mount.x_m - s * mount.y_m, y: place.y + s * mount.x_m + c * mount.y_m };
}

function cone(context, view, eye, axis, opening, range) {
  const [x, y] = view.toScreen(eye);
  context.beginPath();
  context.moveTo(x, y);
  context.arc(x, y, range * view.scale, -axis - opening / 2, -axis + opening / 2);
  context.closePath();
  context.fillStyle = "rgba(255, 255, 255, 0.32)";
  context.fill();
  context.strokeStyle = INK;
  context.lineWidth = 1;
  context.stroke();
}

function danger(context, view, [a, b, c]) {
  const [px, py, qx, qy] = [b.x_m - a.x_m, b.y_m - a.y_m, c.x_m - a.x_m, c.y_m - a.y_m];
  const twice = 2 * (px * qy - py * qx);
  if (Math.abs(twice) < 1e-9) return;
  const [pp, qq] = [px * px + py * py, qx * qx + qy * qy];
  const [cx, cy] = [(qy * pp - py * qq) / twice, (px * qq - qx * pp) / twice];
  const [x, y] = view.toScreen({ x: a.x_m + cx, y: a.y_m + cy });
  context.save();
  context.setLineDash([6, 5]);
  context.beginPath();
  context.arc(x, y, Math.hypot(cx, cy) * view.scale, 0, 2 * Math.PI);
  context.strokeStyle = PLACE;
  context.lineWidth = 1.5;
  context.stroke();
  context.restore();
}

export function route(context, view, found, color, factor, isDashed) {
  const points = found.path.map((p) => view.toScreen({ x: p.x_m, y: p.y_m }));
  let last = null;
  let isCut = false;
  found.path.forEach((p, k) => {
    const [x, y] = points[k];
    if (!p.ellipse95 || (last && Math.hypot(x - last[0], y - last[1]) < SPACING_PX)) return;
    last = [x, y];
    isCut = ellipse(context, view, { x: p.x_m, y: p.y_m }, p.ellipse95, factor, color) || isCut;
  });
  context.save();
  context.lineJoin = "round";
  context.lineCap = "round";
  polyline(context, points, "rgba(255, 255, 255, 0.9)", 6);
  if (isDashed) context.setLineDash([9, 6]);
  polyline(context, points, color, 3);
  context.restore();
  return isCut;
}

// Another route that could be chosen: where it goes, no more.
export function faint(context, view, found) {
  const points = found.path.map((p) => view.toScreen({ x: p.x_m, y: p.y_m }));
  polyline(context, points, "rgba(255, 255, 255, 0.75)", 3.5);
  polyline(context, points, `${CHOSEN}b0`, 1.5);
}

// Where along a route: the pose at a length, between its points.
export function poseAt(path, s) {
  const k = path.findIndex((p) => p.s_m >= s);
  if (k <= 0) return k === 0 ? path[0] : null;
  const [a, b] = [path[k - 1], path[k]];
  const t = (s - a.s_m) / Math.max(1e-12, b.s_m - a.s_m);
  return { ...(t < 0.5 ? a : b), x_m: a.x_m + t * (b.x_m - a.x_m), y_m: a.y_m + t * (b.y_m - a.y_m) };
}

export function end(context, view, p, text, color) {
  const [x, y] = view.toScreen(p);
  disc(context, x, y, 10, color);
  context.font = "bold 12px system-ui, sans-serif";
  context.fillStyle = "#ffffff";
  context.textAlign = "center";
  context.textBaseline = "middle";
  context.fillText(text, x, y + 0.5);
  context.textAlign = "start";
  context.textBaseline = "alphabetic";
}

export function cursor(context, view, p) {
  const [x, y] = view.toScreen(p);
  for (const [color, width] of [["#ffffff", 4], [INK, 1.6]]) {
    line(context, [x - 12, y], [x + 12, y], color, width);
    line(context, [x, y - 12], [x, y + 12], color, width);
  }
}

export function cross(context, view, p, color) {
  const [x, y] = view.toScreen(p);
  for (const [paint, width] of [["#ffffff", 6], [color, 3]]) {
    line(context, [x - 7, y - 7], [x + 7, y + 7], paint, width);
    line(context, [x - 7, y + 7], [x + 7, y - 7], paint, width);
  }
}

// A bar of a round length, so that the map has a measure.
export function measure(context, view) {
  const [least, bases] = [60 / view.scale, [1, 2, 5, 10]];
  const decade = 10 ** Math.floor(Math.log10(least));
  const length = bases.map((base) => base * decade).find((value) => value >= least);
  const [x, y, wide] = [14, view.height - 16, length * view.scale];
  for (const [color, width] of [["#ffffff", 5], [INK, 2]]) {
    line(context, [x, y], [x + wide, y], color, width);
    for (const at of [x, x + wide]) line(context, [at, y - 4], [at, y + 4], color, width);
  }
  label(context, x + 4, y - 8, length >= 1 ? `${length} m` : `${significant(1000 * length)} mm`);
}

function disc(context, x, y, radius, color) {
  context.beginPath();
  context.arc(x, y, radius, 0, 2 * Math.PI);
  context.fillStyle = color;
  context.fill();
  context.strokeStyle = "#ffffff";
  context.lineWidth = 1.5;
  context.stroke();
}

function line(context, from, to, color, width) {
  polyline(context, [from, to], color, width);
}

function polyline(context, points, color, width) {
  context.beginPath();
  points.forEach(([x, y], k) => (k ? context.lineTo(x, y) : context.moveTo(x, y)));
  context.strokeStyle = color;
  context.lineWidth = width;
  context.stroke();
}

function label(context, x, y, text) {
  context.font = "11px system-ui, sans-serif";
  context.lineJoin = "round";
  context.strokeStyle = "rgba(255, 255, 255, 0.9)";
  context.lineWidth = 3;
  context.strokeText(text, x, y);
  context.fillStyle = INK;
  context.fillText(text, x, y);
}
