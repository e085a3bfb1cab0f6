// Landmarks: choose, move, add, remove; kept as a new version of the map.

import { $, fillSelect, numberIn, say } from "./dom.js";
import { order, sameOrder } from "./field_panel.js";
import { getJson, sendJson } from "./http.js";
import { chooseMap, loadMaps } from "./map_panel.js";
import { view } from "./map_view.js";
import { listen, set, state } from "./state.js";
import { clearTrouble, showTrouble } from "./troubles.js";

const REACH_PX = 14; // of a pointer to a landmark
let like = null; // the field that was shown last: a new version of its map gets one like it
let listed = [null]; // names in the list; null: it was never filled

export function startMarks() {
  $("mark-choice").addEventListener("change", () => set({ mark: $("mark-choice").value === "" ? null : Number($("mark-choice").value) }));
  for (const id of ["mark-id", "mark-x", "mark-y", "mark-facing"]) $(id).addEventListener("change", fromForm);
  $("mark-add").addEventListener("click", () => {
    set({ tool: "marks", adding: true });
    say("Click on the map where the landmark stands, or press Enter at the cursor.");
  });
  $("mark-remove").addEventListener("click", removeMark);
  $("marks-save").addEventListener("click", () => save().catch(failed));
  $("marks-discard").addEventListener("click", () => {
    clearTrouble("marks-trouble");
    set({ marks: state.marksRead, mark: null, edited: false });
  });
  listen(["marks", "mark"], show);
  listen(["map"], () => clearTrouble("marks-trouble"));
  listen(["field"], () => {
    if (state.field) like = { field: state.field, name: state.map.name };
  });
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
  if (!state.adding) {
    set({ mark: markAt(p) });
    return;
  }
  set({ adding: false });
  const added = { id: freshName(), x_m: rounded(p.x), y_m: rounded(p.y), facing_rad: null, half_angle_rad: Math.PI, sigma_m: 0 };
  edit([...state.marks, added], state.marks.length);
  say(`Landmark ${added.id} is added; save to keep it.`);
}

// Whether there was one to remove.
export function removeMark() {
  if (state.mark === null) return false;
  edit(state.marks.filter((_, k) => k !== state.mark), null);
  say("The landmark is removed; save to keep it so.");
  return true;
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

async function save() {
  clearTrouble("marks-trouble");
  const { map } = state;
  const sent = { map: map.map, landmarks: state.marks };
  const stored = await sendJson("PUT", map.links.landmarks, sent, { "If-Match": state.marksTag });
  keepColours();
  await loadMaps();
  await chooseMap(stored.map);
  say("The landmarks are kept as a new version of the map.");
  if (like?.name === stored.name) await order(sameOrder(like.field, stored.map));
}

// The new field in the colours of the old one, so that the change is seen; emptying the boxes undoes it.
function keepColours() {
  if (!state.range) return;
  const [low, high] = state.range;
  [$("low").value, $("high").value] = state.range;
  set({ low, high });
}

function failed(error) {
  if (error.status === 412) {
    error.title = "This is not the newest version of the map";
    error.message = "Other landmarks were saved meanwhile, or an older version was chosen. Your changes are still in the picture, nothing is lost.";
  }
  showTrouble("marks-trouble", error, { rebase: (newest) => rebase(newest).catch(failed) });
}

// The same changes on the newest version: where both changed a landmark, the ones made here hold.
async function rebase(newest) {
  const before = new Map(state.marksRead.map((mark) => [mark.id, JSON.stringify(mark)]));
  const after = new Set(state.marks.map((mark) => mark.id));
  const changed = new Map(state.marks.filter((mark) => before.get(mark.id) !== JSON.stringify(mark)).map((mark) => [mark.id, mark]));
  keepColours();
  await loadMaps();
  await chooseMap(newest);
  const kept = state.marks.filter((mark) => after.has(mark.id) || !before.has(mark.id)).map((mark) => changed.get(mark.id) ?? mark);
  const ids = new Set(kept.map((mark) => mark.id));
  edit([...kept, ...[...changed.values()].filter((mark) => !ids.has(mark.id))], null);
  say("Your changes are on the newest version now; look, then save.");
}
