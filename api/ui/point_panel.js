// A place that was asked for: values, best triplet, the others, and why it is bad.

import { $, make, numberIn, say } from "./dom.js";
import { degrees, inUnit, metres, percent, place as written, squareMetres } from "./format.js";
import { getJson } from "./http.js";
import { redraw } from "./map_view.js";
import { listen, set, state } from "./state.js";
import { clearTrouble, showTrouble } from "./troubles.js";

const RANKED = 10;
const HOVER_MS = 70;
const STATES = { outside: "Outside the map", occupied: "Not free floor", no_fix: "No fix here", fix: "A fix is possible" };
let hovering;
let stop;

const address = (p, more = "") => `${state.field.links.point}?x_m=${p.x.toFixed(4)}&y_m=${p.y.toFixed(4)}${more}`;

export function startPoint() {
  $("place-form").addEventListener("submit", (event) => {
    event.preventDefault();
    const [x, y] = [numberIn("place-x"), numberIn("place-y")];
    if (x === null || y === null) say("Type x and y in metres.");
    else askAt({ x, y });
  });
  $("place-clear").addEventListener("click", () => set({ place: null, point: null, triplet: null }));
  listen(["place", "point"], show);
  listen(["field"], () => {
    if (state.field && state.place) askAt(state.place);
  });
}

// A service that knows rankings answers with one; an older one leaves it out.
export async function askAt(place) {
  set({ place, point: null, triplet: null });
  $("place-x").value = place.x.toFixed(2);
  $("place-y").value = place.y.toFixed(2);
  if (!state.field) {
    $("place-words").textContent = "Choose or build a field first: it holds the values.";
    return;
  }
  clearTrouble("place-trouble");
  try {
    const point = await getJson(address(place, `&ranking=${RANKED}`));
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
      const point = await getJson(address(place), { signal: stop.signal });
      const value = point.metrics[state.metric];
      const said = value === null ? STATES[point.state] : inUnit(value, state.facts.metrics[state.metric].unit);
      $("under").textContent = `${written(place)}  ${said}${point.valid === false ? ", not valid" : ""}`;
    } catch {
      // The pointer has moved on, or the next value will tell.
    }
  }, HOVER_MS);
}

function summary(point) {
  const { area95_m2: area, r95_m: radius } = point.metrics;
  const values = point.state === "fix" ? `: area of the 95 % ellipse ${squareMetres(area)}, r95 ${metres(radius)}` : "";
  return `${STATES[point.state]}${values}. ${wordsOf(point.reason)}`;
}

// One text, or several reasons with words of their own.
function wordsOf(reason) {
  if (!reason) return "";
  if (typeof reason === "string") return reason;
  return [reason].flat().map((one) => one.message ?? one.words ?? one.detail ?? String(one)).join(" ");
}

function show() {
  const { point, place } = state;
  $("place-empty").hidden = Boolean(place);
  $("place-drawn").hidden = !point?.ellipse95;
  $("place-words").textContent = point ? `${STATES[point.state]} at ${written(place)}.` : "";
  const reasons = [point?.reason, point?.reasons].flat().filter(Boolean).map(wordsOf);
  $("place-why").textContent = [...new Set(reasons)].join(" ");
  $("place-why").hidden = !reasons.length;
  $("place-values").replaceChildren(...(point ? rows(point) : []));
  ranking(point);
}

function rows(point) {
  const { metrics, ellipse95: e } = point;
  const found = [
    ["Area of the 95 % ellipse", squareMetres(metrics.area95_m2)],
    ["r95", metres(metrics.r95_m)],
    ["Semi-axes", e ? `${metres(e.a_m)} × ${metres(e.b_m)}, major at ${degrees(e.theta_rad)}` : null],
    ["σ of the heading", degrees(metrics.sigma_theta_rad)],
    ["Fixes inside the ellipse", point.validity === null ? null : percent(point.validity)],
    ["Landmarks in view", point.n_visible === null ? null : String(point.n_visible)],
    ["Best triplet", point.triplet?.join(", ")],
    ["Camera's pan", point.pan_rad === null ? null : degrees(point.pan_rad)],
  ];
  return found
    .filter(([, value]) => value && value !== "–")
    .map(([name, value]) => make("tr", {}, make("th", { scope: "row", textContent: name }), make("td", { textContent: value })));
}

function ranking(point) {
  const found = [point?.ranking?.triplets ?? point?.ranking].flat().filter(Boolean).map(ranked);
  $("ranking").hidden = !found.length;
  $("ranking-rows").replaceChildren(
    ...found.map((row, k) => {
      const choose = make("button", { type: "button", className: "row", textContent: row.triplet.join(", ") });
      choose.addEventListener("click", () => {
        set({ triplet: k ? row : null });
        for (const other of $("ranking-rows").querySelectorAll("button")) other.ariaPressed = String(other === choose);
        redraw();
        say(`Shown: ${row.triplet.join(", ")}, area ${squareMetres(row.area)}`);
      });
      choose.ariaPressed = String(k === 0);
      return make("tr", {}, make("td", { textContent: String(k + 1) }), make("td", {}, choose), make("td", { textContent: squareMetres(row.area) }));
    }),
  );
}

function ranked(row) {
  const names = (row.triplet ?? row.landmarks ?? []).map((mark) => mark.id ?? mark);
  const ellipse95 = row.ellipse95 ?? null;
  const area = row.metrics?.area95_m2 ?? row.area95_m2 ?? (ellipse95 ? Math.PI * ellipse95.a_m * ellipse95.b_m : null);
  return { triplet: names, ellipse95, pan_rad: row.pan_rad ?? null, area };
}
