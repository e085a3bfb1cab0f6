// Choose a map, or send one.

import { $, fillSelect, say } from "./dom.js";
import { ask, getJson } from "./http.js";
import { chooseField, loadFields } from "./field_panel.js";
import { fit, floor, redraw } from "./map_view.js";
import { set, state } from "./state.js";
import { clearTrouble, showTrouble } from "./troubles.js";

const PREFERRED = "warehouse"; // bundled with the service: there is always something to try

export function startMaps() {
  $("map-choice").addEventListener("change", () => {
    if (state.edited && !confirm("The changed landmarks are not saved. Leave them?")) {
      $("map-choice").value = state.map.map;
      return;
    }
    chooseMap($("map-choice").value).catch((error) => showTrouble("map-trouble", error));
  });
  $("upload").addEventListener("submit", (event) => {
    event.preventDefault();
    upload().catch((error) => showTrouble("map-trouble", error));
  });
}

export async function loadMaps() {
  const { maps } = await getJson("/v1/maps");
  set({ maps });
  const times = new Map();
  for (const { name } of maps) times.set(name, (times.get(name) ?? 0) + 1);
  const label = (m) => (times.get(m.name) > 1 ? `${m.name}, ${m.created.slice(5, 16).replace("T", " ")} UTC, ${m.landmarks} landmarks` : m.name);
  fillSelect($("map-choice"), maps.map((m) => [m.map, label(m)]), state.map?.map);
  $("map-choice").disabled = !maps.length;
  if (!maps.length) say("There is no map yet. Upload one to begin.");
}

export const preferredMap = () => (state.maps.find((m) => m.name === PREFERRED) ?? state.maps[0])?.map;

export async function chooseMap(id, wanted = {}) {
  clearTrouble("map-trouble");
  const map = state.maps.find((m) => m.map === id) ?? (await getJson(`/v1/maps/${encodeURIComponent(id)}`));
  // Another version of what is shown, by all appearances: places that were chosen still mean something.
  const isSameFloor = Boolean(state.map) && map.name === state.map.name && same(map.bounds, state.map.bounds);
  await Promise.all([floor.load(map), readLandmarks(map)]);
  const emptied = isSameFloor ? {} : { start: null, goal: null, place: null };
  set({ map, field: null, plan: null, point: null, triplet: null, mark: null, trouble: [], ...emptied });
  $("map-choice").value = map.map;
  if (!isSameFloor) fit();
  $("map-facts").textContent = facts(map);
  await loadFields();
  await chooseField(wanted.field);
  redraw();
}

const same = (a, b) => Object.keys(a).every((key) => a[key] === b[key]);

// With the tag under which they were read: whoever changes them says what they change.
async function readLandmarks(map) {
  const answer = await ask(map.links.landmarks);
  const { landmarks } = await answer.json();
  set({ marks: landmarks, marksRead: landmarks, marksTag: answer.headers.get("ETag"), edited: false, adding: false });
}

function facts(map) {
  const { bounds, landmarks, free_area_m2: area } = map;
  const size = `${(bounds.x_max_m - bounds.x_min_m).toFixed(1)} × ${(bounds.y_max_m - bounds.y_min_m).toFixed(1)} m`;
  return `${size}, ${landmarks} landmarks${area ? `, ${area.toFixed(0)} m² of free floor` : ""}`;
}

async function upload() {
  const [world] = $("upload-world").files;
  const [image] = $("upload-image").files;
  const [meta] = $("upload-meta").files;
  const [landmarks] = $("upload-landmarks").files;
  const name = $("upload-name").value.trim();
  clearTrouble("map-trouble");
  let answer;
  if (world) {
    const where = name ? `/v1/maps?name=${encodeURIComponent(name)}` : "/v1/maps";
    answer = await ask(where, { method: "POST", body: world, headers: { "Content-Type": "application/json" } });
  } else if (image && meta) {
    const form = new FormData();
    form.append("image", image);
    form.append("meta", meta);
    if (landmarks) form.append("landmarks", landmarks);
    if (name) form.append("name", name);
    answer = await ask("/v1/maps", { method: "POST", body: form });
  } else {
    throw Object.assign(new Error("Choose a world.geojson, or an image together with its map.yaml."), { title: "A file is missing" });
  }
  const stored = await answer.json();
  await loadMaps();
  await chooseMap(stored.map);
  $("upload").reset();
  $("findings").replaceChildren(
    ...stored.findings.map(({ severity, message }) => Object.assign(document.createElement("li"), { textContent: `${severity}: ${message}` })),
  );
  say(`Map ${stored.name} is stored, with ${stored.landmarks} landmarks. Build a field next.`);
  $("upload-box").open = Boolean(stored.findings.length); // they stand in it
  $("build-box").open = true;
  $("build-box").scrollIntoView();
}
