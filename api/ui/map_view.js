// The map: floor, field, and everything over it on one canvas.

import { $, say } from "./dom.js";
import * as draw from "./draw.js";
import { Floor, OUTSIDE } from "./floor.js";
import { gestures } from "./gestures.js";
import { Heat, suitableRange } from "./heat.js";
import { listen, set, state } from "./state.js";
import { View } from "./view.js";

export const view = new View();
export const floor = new Floor();
const POINT_PX = 24; // semi-axis of a single ellipse, at least
let heat;
let isAsked = false;
let isTouched = false; // until somebody moves it, the map fits whatever size it has

export function startMap(acts, failed) {
  const canvas = $("map");
  heat = new Heat(redraw, failed);
  gestures(canvas, view, { ...acts, changed: moved });
  new ResizeObserver(() => resize(canvas)).observe(canvas);
  resize(canvas);
  $("zoom-in").addEventListener("click", () => zoomBy(1.5));
  $("zoom-out").addEventListener("click", () => zoomBy(1 / 1.5));
  $("fit").addEventListener("click", fit);
  listen(["field", "range", "colormap", "heading"], () => {
    if (!state.field) heat.clear();
    show();
  });
  listen(["marks", "mark", "cursor", "point", "place", "triplet", "start", "goal", "plan", "route", "along", "opacity", "trouble", "cloud"], redraw);
  listen(["metric", "scale", "heading"], () => chooseRange().catch(failed));
}

// Ends of the colours: what was typed, else what suits the field.
export async function chooseRange() {
  const { field, metric, scale, heading, low, high } = state;
  if (!field) return;
  const isTyped = low !== null && high !== null && isRange(low, high, scale);
  const found = isTyped ? [low, high] : await suitableRange(field, metric, scale, heading);
  if (field !== state.field || metric !== state.metric || scale !== state.scale || heading !== state.heading) return; // changed meanwhile
  const range = [low ?? found[0], high ?? found[1]];
  if (isRange(...range, scale)) {
    set({ range });
  } else {
    set({ range: found });
    say(`From must be below To${scale === "log" ? " and above zero" : ""}; automatic colours are shown.`);
  }
}

const isRange = (low, high, scale) => low < high && (scale === "linear" || low > 0);

function resize(canvas) {
  const density = window.devicePixelRatio || 1;
  view.width = Math.max(1, canvas.clientWidth);
  view.height = Math.max(1, canvas.clientHeight);
  canvas.width = Math.round(view.width * density);
  canvas.height = Math.round(view.height * density);
  if (state.map && !isTouched) fit();
  else show();
  paint();
}

export function fit() {
  if (state.map) view.fit(state.map.bounds);
  isTouched = false;
  show();
}

export function zoomBy(factor) {
  view.zoom(factor, view.width / 2, view.height / 2);
  moved();
}

export function lookAt({ x, y, scale }) {
  Object.assign(view, { x, y, scale });
  moved();
}

function moved() {
  isTouched = true;
  show();
}

// The view, or what it shows, is another: ask for what is in it.
function show() {
  set({ view: {} }); // for the permalink
  if (state.field && state.range && state.field.status === "ready") {
    const { metric, scale, colormap, range, heading } = state;
    heat.show(state.field, { metric, scale, colormap, range, heading }, view);
  }
  redraw();
}

export function redraw() {
  if (isAsked) return;
  isAsked = true;
  requestAnimationFrame(() => {
    isAsked = false;
    paint();
  });
}

function paint() {
  const canvas = $("map");
  const context = canvas.getContext("2d");
  const density = canvas.width / view.width;
  context.setTransform(density, 0, 0, density, 0, 0);
  context.clearRect(0, 0, view.width, view.height);
  if (!state.map) return;
  context.fillStyle = OUTSIDE;
  floor.draw(context, view);
  if (state.field) heat.draw(context, view, state.field.bounds, state.opacity);
  const used = state.point ? (state.triplet?.triplet ?? state.point.triplet ?? []) : [];
  draw.landmarks(context, view, state.marks, state.mark, used, statuses());
  const factor = enlargementNow();
  const along = alongNow();
  let isCut = paintRoutes(context, factor);
  if (state.place) {
    const { place, point, triplet, marks, field, cloud } = state;
    const own = enlargementOfPoint();
    draw.point(context, view, { place, answer: point, triplet, marks, field, cloud, factor: own });
    $("place-drawn").textContent = own > 1 && point ? `Its ellipse${cloud?.cloud ? " and the fixes are" : " is"} drawn ${own} × larger.` : "";
  }
  const larger = factor > 1 ? `Ellipses drawn ${factor} × larger` : "";
  $("enlarged").textContent = isCut ? `${larger}, dashed ones less` : larger;
  if (state.start) draw.end(context, view, state.start, "S", "#1d7a3a");
  if (state.goal) draw.end(context, view, state.goal, "G", "#20242a");
  for (const place of state.trouble) draw.cross(context, view, place, "#be1428");
  for (const p of along) draw.cursor(context, view, { x: p.x_m, y: p.y_m });
  if (state.cursor) draw.cursor(context, view, state.cursor);
  draw.measure(context, view);
}

// What the inspected place has to say of each landmark.
function statuses() {
  return new Map((state.point?.ranking?.landmarks ?? []).map((mark) => [mark.id, mark.status]));
}

function routesShown() {
  const { plan, route } = state;
  const shown = [
    [plan?.shortest_baseline, draw.SHORTEST, true],
    [plan?.routes[route], draw.CHOSEN, false],
  ];
  return shown.filter(([found]) => found?.path?.length);
}

function paintRoutes(context, factor) {
  for (const [k, found] of (state.plan?.routes ?? []).entries()) {
    if (k !== state.route && found.path.length) draw.faint(context, view, found);
  }
  const cut = routesShown().map(([found, color, isDashed]) => draw.route(context, view, found, color, factor, isDashed));
  return cut.some(Boolean);
}

// Where the pointer in the profile is, on every route that is shown.
function alongNow() {
  if (state.along === null) return [];
  return routesShown()
    .map(([found]) => draw.poseAt(found.path, state.along))
    .filter(Boolean);
}

function enlargementNow() {
  const path = state.plan?.routes[state.route]?.path ?? state.plan?.shortest_baseline?.path ?? [];
  const axes = path.filter((p) => p.ellipse95).map((p) => p.ellipse95.a_m);
  return draw.enlargement(axes, view.scale);
}

// Of its own: a place that is asked for may be far worse than any route.
function enlargementOfPoint() {
  const shape = state.triplet?.ellipse95 ?? state.point?.ellipse95;
  return draw.enlargement(shape ? [shape.a_m] : [], view.scale, POINT_PX);
}
