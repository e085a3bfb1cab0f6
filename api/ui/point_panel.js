// A place that was asked for: values, best triplet, the others, and why it is bad.

import { $, make, numberIn, say } from "./dom.js";
import { degrees, inUnit, metres, percent, place as written, squareMetres } from "./format.js";
import { getJson, query } from "./http.js";
import { thetaShown } from "./headings.js";
import { ranking } from "./ranking.js";
import { listen, set, state } from "./state.js";
import { clearTrouble, showTrouble } from "./troubles.js";

const RANKED = 10;
const HOVER_MS = 70;
const STATES = { outside: "Outside the map", occupied: "Not free floor", no_fix: "No fix here", fix: "A fix is possible" };
// As the service counts landmarks at a place, in words after a number.
const STATUSES = {
  too_near: "too near",
  too_far: "too far",
  turned_away: "facing away",
  hidden: "hidden",
  muted: "in a muted sector",
  outside_view: "outside the view",
};
let hovering;
let stop;

function address(p, more = {}) {
  return `${state.field.links.point}?${query({ x_m: p.x.toFixed(4), y_m: p.y.toFixed(4), ...more })}`;
}

export function startPoint() {
  $("place-form").addEventListener("submit", (event) => {
    event.preventDefault();
    const [x, y] = [numberIn("place-x"), numberIn("place-y")];
    if (x === null || y === null) say("Type x and y in metres.");
    else askAt({ x, y });
  });
  $("place-clear").addEventListener("click", () => {
    clearTrouble("place-trouble");
    set({ place: null, point: null, triplet: null });
    $("place-x").value = $("place-y").value = "";
  });
  $("place-heading").addEventListener("change", () => {
    const theta = $("place-heading").value;
    askAt(state.place, theta === "" ? null : Number(theta));
  });
  listen(["place", "point"], show);
  listen(["field", "heading"], () => {
    if (state.field && state.place) askAt(state.place);
  });
}

// theta: heading of the robot, rad; null: the best one there.
export async function askAt(place, theta = thetaShown()) {
  set({ place, point: null, triplet: null });
  $("place-x").value = place.x.toFixed(2);
  $("place-y").value = place.y.toFixed(2);
  clearTrouble("place-trouble");
  if (!state.field) {
    $("place-words").textContent = "Choose or build a field first: it holds the values.";
    return;
  }
  try {
    const point = await getJson(address(place, { theta_rad: theta, ranking: RANKED }));
    if (state.place !== place) return;
    set({ point });
    say(summary(point));
  } catch (error) {
    showTrouble("place-trouble", error);
  }
}

// Value under the pointer, in the corner of the map.
export function hover(place) {
  clearTimeout(hovering);
  if (!place || !state.field) {
    $("under").textContent = "";
    return;
  }
  hovering = setTimeout(async () => {
    stop?.abort();
    stop = new AbortController();
    try {
      const { value, words } = await valueAt(place, { signal: stop.signal });
      const said = value === null ? words : `${inUnit(value, state.facts.metrics[state.metric].unit)}${words}`;
      $("under").textContent = `${written(place)}  ${said}`;
    } catch {
      // The pointer has moved on, or the next value will tell.
    }
  }, HOVER_MS);
}

// What the map shows there: over headings the worst and the mean are of no single pose.
async function valueAt(place, options) {
  const { field, heading, metric } = state;
  if (field.headings > 1 && ["worst", "mean"].includes(heading)) {
    const half = field.resolution_m / 10;
    const bbox = [place.x - half, place.y - half, place.x + half, place.y + half].map((v) => v.toFixed(4)).join(",");
    const { values } = await getJson(`${field.links.self}/heatmap.json?${query({ metric, heading, bbox })}`, options);
    return { value: values[0][0], words: values[0][0] === null ? "no value" : "" };
  }
  const point = await getJson(address(place, { theta_rad: thetaShown() }), options);
  const value = point.metrics[metric];
  return { value, words: value === null ? STATES[point.state] : point.valid === false ? ", not valid" : "" };
}

function summary(point) {
  const { area95_m2: area, r95_m: radius } = point.metrics;
  const values = point.state === "fix" ? `: area of the 95 % ellipse ${squareMetres(area)}, r95 ${metres(radius)}` : "";
  return `${STATES[point.state]}${values}. ${reasons(point).join(" ")}`;
}

// What the field says of its own numbers, and what the ranking says of landmarks.
function reasons(point) {
  const own = point.ranking?.reason && point.state === "no_fix" ? null : point.reason; // the ranking says more
  return [own, point.ranking?.reason].filter(Boolean);
}

function show() {
  const { point, place } = state;
  $("place-empty").hidden = Boolean(place);
  $("place-drawn").hidden = !point?.ellipse95;
  const turned = point?.headings ? `, heading ${degrees(point.heading_rad)}` : "";
  $("place-words").textContent = point ? `${STATES[point.state]} at ${written(place)}${turned}.` : "";
  const found = point ? reasons(point) : [];
  $("place-why").replaceChildren(...found.map((text) => make("p", { textContent: text })));
  $("place-why").className = point?.state === "fix" && point.valid !== false ? "why fine" : "why";
  $("place-why").hidden = !found.length;
  $("place-values").replaceChildren(...(point ? rows(point) : []));
  showHeadings(point);
  ranking(point);
}

function rows(point) {
  const { metrics, ellipse95: e } = point;
  const found = [
    ["Area of the 95 % ellipse", squareMetres(metrics.area95_m2)],
    ["r95: radius of a circle as large", metres(metrics.r95_m)],
    ["Semi-axes", e ? `${metres(e.a_m)} × ${metres(e.b_m)}, major at ${degrees(e.theta_rad)}` : null],
    ["σ of the heading", degrees(metrics.sigma_theta_rad)],
    ["Predicted share of fixes inside", point.validity === null ? null : percent(point.validity)],
    ["Landmarks in view", point.n_visible === null ? null : inView(point)],
    ["Best triplet", point.triplet?.join(", ")],
    ["Camera's pan", point.pan_rad === null ? null : degrees(point.pan_rad)],
  ];
  return found
    .filter(([, value]) => value && value !== "–")
    .map(([name, value]) => make("tr", {}, make("th", { scope: "row", textContent: name }), make("td", { textContent: value })));
}

// As in: 20 of 85 (40 too far, 25 hidden)
function inView(point) {
  const marks = point.ranking?.landmarks;
  if (!marks) return String(point.n_visible);
  const others = Object.entries(STATUSES)
    .map(([status, words]) => [marks.filter((mark) => mark.status === status).length, words])
    .filter(([count]) => count);
  const listed = others.length ? ` (${others.map(([count, words]) => `${count} ${words}`).join(", ")})` : "";
  return `${point.n_visible} of ${marks.length}${listed}`;
}

// Of a field over headings: what each one gives at this place.
function showHeadings(point) {
  const all = point?.headings ?? [];
  $("place-headings").hidden = !all.length;
  const options = all.map((one) => {
    const value = one.state === "fix" ? `r95 ${metres(one.r95_m)}` : "no fix";
    return make("option", { value: one.theta_rad, textContent: `${degrees(one.theta_rad)}: ${value}` });
  });
  $("place-heading").replaceChildren(make("option", { value: "", textContent: "the best one" }), ...options);
  if (all.length) $("place-heading").value = String(point.heading_rad);
  const good = all.filter((one) => one.state === "fix").length;
  $("place-headings-words").textContent = all.length ? `A fix at ${good} of ${all.length} headings.` : "";
}
