// Start, goal, objective and bounds; the answer in figures and words.

import { $, fillSelect, make, numberIn, say } from "./dom.js";
import { metres, probability, seconds, squareMetres, way } from "./format.js";
import { order } from "./field_panel.js";
import { sendJson, whenFree } from "./http.js";
import { watch } from "./jobs.js";
import { nameOf, showProfile } from "./profile.js";
import { listen, set, state } from "./state.js";
import { clearTrouble, showTrouble } from "./troubles.js";

const CONTROLS = ["objective", "weight", "covariance", "max-r95", "max-risk", "max-blind", "radius", "speed", "deadline"];
const WORDS = {
  exact: "The best path for this objective.",
  approximate: "A good path; that none is better is not proven.",
  risk_unmet: "No path keeps the bounds; this is the best effort.",
  timeout: "The time ran out.",
  no_path: "There is no path between start and goal for this robot.",
};
const defaults = {};
let asked = 0;
let flying = null; // the question that is not answered yet

export function startPlans() {
  for (const id of CONTROLS) {
    defaults[id] = $(id).value;
    $(id).addEventListener("change", () => {
      showObjective();
      if (state.start && state.goal) plan();
    });
  }
  showObjective();
  $("plan-form").addEventListener("submit", (event) => {
    event.preventDefault();
    typed();
    plan();
  });
  for (const id of ["start-x", "start-y", "goal-x", "goal-y"]) $(id).addEventListener("change", typed);
  $("plan-clear").addEventListener("click", () => {
    set({ start: null, goal: null, plan: null, trouble: [] });
    clearTrouble("plan-trouble");
  });
  $("route-choice").addEventListener("change", () => {
    set({ route: Number($("route-choice").value) });
    showFigures();
  });
  listen(["start", "goal"], showEnds);
  listen(["field"], () => {
    if (state.field && state.start && state.goal) plan();
  });
  listen(["plan"], () => {
    showFigures();
    showProfile();
  });
  listen(["route"], showProfile);
  showFigures();
}

// A click on the map: start, then goal, then a new start.
export function clickEnd(place) {
  if (!state.start || state.goal) {
    set({ start: place, goal: null, plan: null, trouble: [] });
    clearTrouble("plan-trouble");
    say("Start is set. Choose the goal.");
  } else {
    set({ goal: place });
    plan();
  }
}

export function setEnd(which, place) {
  set({ [which]: place, plan: null, trouble: [] });
  if (state.start && state.goal) plan();
  else say(`${which === "start" ? "Start" : "Goal"} is set.`);
}

function typed() {
  for (const which of ["start", "goal"]) {
    const [x, y] = [numberIn(`${which}-x`), numberIn(`${which}-y`)];
    const before = state[which];
    if (x === null || y === null || (before && before.x.toFixed(2) === x.toFixed(2) && before.y.toFixed(2) === y.toFixed(2))) continue;
    set({ [which]: { x, y }, plan: null, trouble: [] });
  }
}

function showEnds() {
  for (const which of ["start", "goal"]) {
    const p = state[which];
    $(`${which}-x`).value = p ? p.x.toFixed(2) : "";
    $(`${which}-y`).value = p ? p.y.toFixed(2) : "";
  }
}

function showObjective() {
  $("weight-row").hidden = $("objective").value !== "weighted";
}

function question() {
  const kind = $("objective").value;
  const objective = { kind, covariance: $("covariance").value };
  if (kind === "weighted") objective.uncertainty_weight_per_m = numberIn("weight") ?? 4;
  const robot = { radius_m: numberIn("radius") ?? 0 };
  if (numberIn("speed")) robot.max_speed_m_s = numberIn("speed");
  const at = (p) => ({ x_m: p.x, y_m: p.y });
  const constraints = {
    max_r95_m: numberIn("max-r95"),
    max_collision_probability: numberIn("max-risk"),
    max_blind_distance_m: numberIn("max-blind"),
  };
  const deadline_s = numberIn("deadline");
  return { field: state.field?.field, start: at(state.start), goal: at(state.goal), robot, objective, constraints, deadline_s };
}

export async function plan() {
  clearTrouble("plan-trouble");
  if (!state.start || !state.goal) {
    say("Choose a start and a goal.");
    return;
  }
  const body = question();
  if (!body.field) {
    delete body.field;
    body.map = state.map.map; // the service says what is missing, and what would help
  }
  const text = JSON.stringify(body);
  if (text === flying) return; // Enter in a box changes it and submits: one question
  flying = text;
  const mine = ++asked;
  $("plan-box").ariaBusy = "true";
  $("verdict").textContent = "Planning …";
  try {
    const waiting = (error) => ($("verdict").textContent = `${error.message} Asking again …`);
    const found = await whenFree(() => sendJson("POST", "/v1/plans", body), waiting);
    if (mine !== asked) return;
    const trouble = found.unmet.map(({ place }) => ({ x: place.x_m, y: place.y_m }));
    set({ plan: found, route: 0, trouble });
    say(spoken(found));
  } catch (error) {
    if (mine !== asked) return;
    set({ plan: null, trouble: [] });
    const isGoal = error.code?.startsWith("goal");
    const use_place = (place) => setEnd(isGoal ? "goal" : "start", place);
    showTrouble("plan-trouble", error, { use_place, watch: (job) => watch(job), order });
  } finally {
    if (mine === asked) {
      flying = null;
      $("plan-box").ariaBusy = "false";
    }
  }
}

function verdict(found) {
  const isBound = Object.entries(found.request.constraints).some(([name, value]) => name.startsWith("max") && value !== null);
  const isKept = isBound && ["exact", "approximate"].includes(found.status);
  return `${WORDS[found.status]}${isKept ? " Every bound is kept." : ""}`;
}

function spoken(found) {
  const [route] = found.routes;
  const figures = route
    ? ` Length ${way(route.length_m)}, mean r95 ${metres(route.uncertainty.mean_r95_m)}, worst ${metres(route.uncertainty.max_r95_m)}.`
    : "";
  return `${verdict(found)}${figures}`;
}

const FIGURES = [
  ["Length", (r) => way(r.length_m)],
  ["Duration", (r) => seconds(r.duration_s)],
  ["Mean r95", (r) => metres(r.uncertainty.mean_r95_m)],
  ["Worst r95", (r) => metres(r.uncertainty.max_r95_m)],
  ["Worst area", (r) => squareMetres(r.uncertainty.max_area95_m2)],
  ["Without a fix", (r) => way(r.uncertainty.blind_m)],
  ["Least clearance", (r) => metres(r.min_clearance_m)],
  ["Worst collision probability", (r) => probability(r.risk.max_collision_probability)],
];

function showFigures() {
  const { plan: found, route } = state;
  $("plan-empty").hidden = Boolean(found || (state.start && state.goal));
  $("figures").hidden = $("plan-files").hidden = !found?.routes.length;
  $("verdict").textContent = found ? verdict(found) : "";
  $("verdict").className = found ? `verdict ${found.status}` : "verdict";
  const said = found ? [...found.unmet.map((u) => u.message), ...found.warnings] : [];
  $("plan-notes").replaceChildren(...said.map((text) => make("li", { textContent: text })));
  $("route-row").hidden = !(found?.routes.length > 1);
  if (!found?.routes.length) return;
  fillSelect($("route-choice"), found.routes.map((r, k) => [String(k), `${k + 1}: ${way(r.length_m)}, worst ${metres(r.uncertainty.max_r95_m)}`]), String(route));
  const columns = [found.routes[route], found.shortest_baseline].filter(Boolean);
  $("figure-chosen").textContent = nameOf(found, route);
  $("figure-shortest").hidden = columns.length < 2;
  $("figure-rows").replaceChildren(
    ...FIGURES.map(([name, say_]) =>
      make(
        "tr",
        {},
        make("th", { scope: "row", textContent: name }),
        ...columns.map((column) => make("td", { textContent: say_(column) })),
      ),
    ),
  );
  const here = `/v1/plans/${found.plan}`;
  $("get-plan").href = here;
  $("get-plan").download = `${found.plan.slice(0, 10)}.json`;
  $("get-picture").href = `${here}/picture.png`;
}

// For the permalink: what differs from a fresh page.
export function controlsInLink() {
  const changed = CONTROLS.filter((id) => $(id).value !== defaults[id]).map((id) => [id, $(id).value]);
  return new URLSearchParams(changed).toString();
}

export function setControls(given) {
  for (const [id, value] of given) if (CONTROLS.includes(id)) $(id).value = value;
  showObjective();
}
