// Landmarks: choose, move, add, remove; kept as a new version of the map.

import { $, fillSelect, numberIn, say } from "./dom.js";
import { order, sameOrder } from "./field_panel.js";
import { getJson, sendJson } from "./http.js";
import { chooseMap, loadMaps } from "./map_panel.js";
import { view } from "./map_view.js";
import { listen, set, state } from "./state.js";
import { clearTrouble, showTrouble } from "./troubles.js";

const REACH_PX = 14; // of a pointer to a landmark
let isAdding = false;
let listed = [null]; // names in the list; null: it was never filled

export function startMarks() {
  $("mark-choice").addEventListener("change", () => set({ mark: $("mark-choice").value === "" ? null : Number($("mark-choice").value) }));
  for (const id of ["mark-id", "mark-x", "mark-y", "mark-facing"]) $(id).addEventListener("change", fromForm);
  $("mark-add").addEventListener("click", () => {
    isAdding = true;
    set({ tool: "marks" });
    say("Click on the map where the landmark stands, or press Enter at the cursor.");
  });
  $("mark-remove").addEventListener("click", () => {
    if (state.mark === null) return;
    edit(state.marks.filter((_, k) => k !== state.mark), null);
    say("The landmark is removed; save to keep it so.");
  });
  $("marks-save").addEventListener("click", () => save().catch((error) => showTrouble("marks-trouble", inWords(error))));
  $("marks-discard").addEventListener("click", () => chooseMap(state.map.map, { field: state.field?.field }).catch((e) => showTrouble("marks-trouble", e)));
  listen(["marks", "mark"], show);
  listen(["edited"], () => ($("marks-save").disabled = $("marks-discard").disabled = !state.edited));
  show();
}

export function markAt(p) {
  const near = state.marks
    .map((mark, index) => ({ index, far: Math.hypot(mark.x_m - p.x, mark.y_m - p.y) * view.scale }))
    .filter(({ far }) => far <= REACH_PX)
    .sort((a, b) => a.far - b.far);
  return near[0]?.index ?? null;
}

export function clickMark(p) {
  if (!isAdding) {
    set({ mark: markAt(p) });
    return;
  }
  isAdding = false;
  const added = { id: freshName(), x_m: rounded(p.x), y_m: rounded(p.y), facing_rad: null, half_angle_rad: Math.PI, sigma_m: 0 };
  edit([...state.marks, added], state.marks.length);
  say(`Landmark ${added.id} is added; save to keep it.`);
}

export function dragMark(p) {
  if (state.mark === null) return;
  change({ x_m: rounded(p.x), y_m: rounded(p.y) });
}

const rounded = (value) => Number(value.toFixed(3)); // nobody places a landmark more exactly by hand

function freshName() {
  const taken = new Set(state.marks.map((mark) => mark.id));
  let k = state.marks.length + 1;
  while (taken.has(`N${k}`)) k += 1;
  return `N${k}`;
}

function change(values) {
  edit(state.marks.map((mark, k) => (k === state.mark ? { ...mark, ...values } : mark)), state.mark);
}

function edit(marks, mark) {
  set({ marks, mark, edited: true });
}

function fromForm() {
  if (state.mark === null) return;
  const before = state.marks[state.mark];
  const facing = numberIn("mark-facing");
  change({
    id: $("mark-id").value.trim() || before.id,
    x_m: numberIn("mark-x") ?? before.x_m,
    y_m: numberIn("mark-y") ?? before.y_m,
    facing_rad: facing === null ? null : (facing * Math.PI) / 180,
    // A landmark that faces somewhere is seen from half around, unless it said otherwise.
    half_angle_rad: facing === null ? Math.PI : before.facing_rad === null ? Math.PI / 2 : before.half_angle_rad,
  });
}

function show() {
  const { marks, mark } = state;
  const names = marks.map((m) => m.id);
  if (names.some((name, k) => name !== listed[k]) || names.length !== listed.length) {
    // Not at every step of a drag: there may be thousands.
    fillSelect($("mark-choice"), [["", "none"], ...names.map((name, k) => [String(k), name])]);
    listed = names;
  }
  $("mark-choice").value = mark === null ? "" : String(mark);
  const chosen = mark === null ? null : marks[mark];
  $("mark-form").disabled = !chosen;
  $("mark-id").value = chosen?.id ?? "";
  $("mark-x").value = chosen?.x_m ?? "";
  $("mark-y").value = chosen?.y_m ?? "";
  $("mark-facing").value = chosen && chosen.facing_rad !== null ? Number(((chosen.facing_rad * 180) / Math.PI).toFixed(2)) : "";
}

// The new version gets a field like the one that was shown.
async function save() {
  clearTrouble("marks-trouble");
  const { map, field } = state;
  const headers = state.marksTag ? { "If-Match": state.marksTag } : {};
  const stored = await sendJson("PUT", `/v1/maps/${map.map}/landmarks`, { landmarks: state.marks }, headers);
  keepColours();
  await loadMaps();
  if (!state.maps.some((m) => m.map === stored.map)) set({ maps: [await getJson(`/v1/maps/${stored.map}`), ...state.maps] });
  await chooseMap(stored.map);
  say("The landmarks are kept as a new version of the map.");
  if (field && !state.field) await order(sameOrder(field, stored.map));
}

// The new field in the colours of the old one, so that the change is seen; emptying the boxes undoes it.
function keepColours() {
  if (!state.range) return;
  const [low, high] = state.range;
  [$("low").value, $("high").value] = state.range;
  set({ low, high });
}

function inWords(error) {
  if (error.status === 404 || error.status === 405) {
    error.title = "Landmarks cannot be changed here";
    error.message = "This service cannot store changed landmarks yet, or the map is gone. The picture keeps your changes until you discard them.";
  } else if (error.status === 412) {
    error.title = "Somebody changed this map meanwhile";
    error.message = "Discard, look at the newest version, and make your change there.";
  }
  return error;
}
