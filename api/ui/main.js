// Everything put together.

import { startBar } from "./bar.js";
import { $, say } from "./dom.js";
import { startClouds } from "./cloud_panel.js";
import { startFields } from "./field_panel.js";
import { isHeading, startHeadings } from "./headings.js";
import { getJson, sendKeyWithDownloads } from "./http.js";
import { keepLink, readLink } from "./link.js";
import { chooseMap, loadMaps, preferredMap, startMaps } from "./map_panel.js";
import { fit, lookAt, redraw, startMap } from "./map_view.js";
import { clickMark, dragMark, markAt, removeMark, startMarks } from "./marks_panel.js";
import { clickEnd, controlsInLink, plan, setControls, setEnd, startPlans } from "./plan_panel.js";
import { askAt, hover, startPoint } from "./point_panel.js";
import { startProfile } from "./profile.js";
import { listen, set, state } from "./state.js";
import { showTrouble } from "./troubles.js";

const failed = (error) => showTrouble("map-trouble", error);
const TOOLS = { path: clickEnd, look: askAt, marks: clickMark };
const HELP = {
  path: "Click start, then goal, for a path.",
  look: "Click a place to see its ellipse and why it is good or bad.",
  marks: "Click a landmark to choose it, drag to move it; then save at the left.",
};

const acts = {
  tapped: (p) => state.map && TOOLS[state.tool](p),
  hovered: (p, isKeyboard = false) => {
    set({ cursor: isKeyboard ? p : null });
    hover(p);
  },
  grabs: (p) => {
    if (state.tool !== "marks") return false;
    const found = markAt(p);
    if (found === null) return false;
    set({ mark: found });
    return true;
  },
  dragged: dragMark,
  dropped: () => say("The landmark is moved; save to keep it."),
  pressed: (key, p) => {
    if (!state.map) return false;
    if (key === "Delete" && state.tool === "marks") return removeMark();
    const keys = { s: () => setEnd("start", p), g: () => setEnd("goal", p), i: () => askAt(p), 0: fit };
    keys[key.toLowerCase()]?.();
    return key.toLowerCase() in keys;
  },
};

async function start() {
  document.documentElement.classList.add("ready");
  const facts = await getJson(new URL("facts.json", import.meta.url));
  set({ facts, colormap: facts.default_colormap });
  const wanted = readLink();
  takeOver(wanted);
  startMaps();
  startFields();
  startHeadings();
  startBar();
  startPlans();
  startPoint();
  startClouds();
  startProfile();
  startMarks();
  setControls(wanted.controls);
  startMap(acts, (error) => showTrouble("field-trouble", error));
  for (const radio of document.querySelectorAll("input[name=tool]")) radio.addEventListener("change", () => chooseTool(radio.value));
  sendKeyWithDownloads(document.querySelectorAll("a[download]"), failed);
  listen(["tool", "adding", "map", "field", "fields"], showTool);
  showTool();
  addEventListener("beforeunload", (event) => {
    if (state.edited) event.preventDefault(); // the browser asks
  });
  await loadMaps();
  keepLink(controlsInLink);
  addEventListener("hashchange", () => location.reload()); // somebody pasted another link
  await open(wanted);
}

function takeOver({ heading, metric, scale, colormap, opacity, range }) {
  const { metrics, colormaps } = state.facts;
  if (isHeading(heading)) set({ heading });
  if (metric in metrics) set({ metric, scale: metrics[metric].scale });
  if (scale === "log" || scale === "linear") set({ scale });
  if (colormap in colormaps) set({ colormap });
  if (opacity >= 0 && opacity <= 1) set({ opacity });
  if (range && range[0] < range[1]) {
    set({ low: range[0], high: range[1] });
    [$("low").value, $("high").value] = range;
  }
}

async function open(wanted) {
  const known = state.maps.some((m) => m.map === wanted.map) ? wanted.map : null;
  if (wanted.map && !known) say("The map of this link is not here; another one is shown.");
  const id = known ?? preferredMap();
  if (!id) {
    $("no-map").hidden = false;
    $("upload-box").open = true;
    $("page").classList.add("empty");
    listen(["map"], () => {
      $("no-map").hidden = true;
      $("page").classList.remove("empty");
    });
    return;
  }
  await chooseMap(id, wanted);
  if (wanted.map && !known) return;
  if (wanted.view) lookAt(wanted.view);
  if (wanted.place) await askAt(wanted.place);
  if (wanted.start || wanted.goal) set({ start: wanted.start, goal: wanted.goal });
  if (wanted.start && wanted.goal) await plan();
}

function chooseTool(tool) {
  set({ tool, adding: false });
  if (tool === "look") return;
  // The panel of the tool takes the place of the other one.
  $("path-box").open = tool === "path";
  $("marks-box").open = tool === "marks";
}

// What to do next.
function help() {
  const { map, field, fields, adding, tool } = state;
  if (!map) return "";
  if (adding) return "Click where the new landmark stands.";
  if (field || tool === "marks") return HELP[tool];
  if (fields.some(({ status }) => status === "running")) return "The field is being computed; its progress is shown at the left.";
  return "This map has no field of uncertainty yet: build one at the left, then plan and inspect.";
}

function showTool() {
  for (const radio of document.querySelectorAll("input[name=tool]")) radio.checked = radio.value === state.tool;
  $("help").textContent = help();
  redraw();
}

start().catch(failed);
