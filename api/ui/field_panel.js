// Choose a field and how it is shown; build one and watch it.

import { $, fillSelect, numberIn, say } from "./dom.js";
import { degrees } from "./format.js";
import { getJson, query, sendJson } from "./http.js";
import { watch } from "./jobs.js";
import { headingsOrdered, showHeadingBoxes } from "./headings.js";
import { headingOf } from "./heat.js";
import { chooseRange } from "./map_view.js";
import { listen, set, state } from "./state.js";
import { clearTrouble, showTrouble } from "./troubles.js";

const KINDS = { omnidirectional: "laser", pinhole_pan: "camera on a pan head", pinhole_fixed: "fixed camera" };
const failed = (error) => showTrouble("field-trouble", error, { order });

export function startFields() {
  const { metrics, metric_order: names, colormaps } = state.facts;
  fillSelect($("metric"), names.map((name) => [name, metrics[name].meaning]), state.metric);
  fillSelect($("colormap"), Object.keys(colormaps).map((name) => [name, name.replace(/_r$/, ", reversed")]), state.colormap);
  $("scale").value = state.scale;
  $("opacity").value = state.opacity;
  $("field-choice").addEventListener("change", () => chooseField($("field-choice").value).catch(failed));
  $("metric").addEventListener("change", () => {
    const metric = $("metric").value;
    $("scale").value = metrics[metric].scale;
    $("low").value = $("high").value = "";
    set({ metric, scale: metrics[metric].scale, low: null, high: null, range: null });
  });
  $("scale").addEventListener("change", () => set({ scale: $("scale").value, range: null }));
  $("colormap").addEventListener("change", () => set({ colormap: $("colormap").value }));
  $("opacity").addEventListener("input", () => set({ opacity: Number($("opacity").value) }));
  for (const id of ["low", "high"]) $(id).addEventListener("change", setRange);
  $("sensor").addEventListener("change", fillSensor);
  for (const id of ["sensor-kind", "headings"]) $(id).addEventListener("change", showKind);
  fillSensor();
  $("build").addEventListener("submit", (event) => {
    event.preventDefault();
    order(orderFromForm()).catch(failed);
  });
  listen(["field"], () => {
    $("get-png").hidden = $("get-npy").hidden = !state.field;
    setDownload();
  });
  listen(["metric", "scale", "colormap", "range", "heading"], setDownload);
}

function setDownload() {
  const { field, metric, scale, colormap, range } = state;
  if (!field) return;
  const heading = headingOf(field, state.heading);
  const wanted = query({ metric, scale, colormap_name: colormap, rescale: range?.join(","), heading, width: 1600 });
  $("get-png").href = `${field.links.heatmap}?${wanted}`;
  $("get-npy").href = `${field.links.values}?${query({ metric, heading })}`;
  $("get-npy").download = `${metric}.npy`;
}

function setRange() {
  set({ low: numberIn("low"), high: numberIn("high") });
  chooseRange().catch(failed);
}

export async function loadFields() {
  const { fields } = await getJson(`/v1/fields?map=${encodeURIComponent(state.map.map)}`);
  set({ fields });
  fillSelect($("field-choice"), fields.map((f) => [f.field, labelOf(f)]));
  $("field-choice").disabled = !fields.length;
}

function labelOf(field) {
  const { sensor } = field;
  const range = sensor.max_range_m ? `${short(sensor.max_range_m)} m` : "any range";
  const ability = `${short(((sensor.fov_rad ?? sensor.bearing_sigma_rad) * 180) / Math.PI)}°`;
  const turned = field.headings > 1 ? `, ${field.headings} headings` : field.heading_rad ? `, heading ${degrees(field.heading_rad)}` : "";
  const all = field.estimator === "all_visible" ? ", all landmarks" : "";
  const status = field.status === "ready" ? "" : ` (${field.status})`;
  return `${KINDS[sensor.kind]} ${ability}${turned}${all}, cell ${short(field.resolution_m)} m, ${range}${status}`;
}

const short = (value) => String(Number(value.toPrecision(3)));

// The one that is wanted, else the newest that is ready; one that is being computed is watched.
export async function chooseField(wanted) {
  clearTrouble("field-trouble");
  const found =
    state.fields.find((f) => f.field === wanted) ??
    state.fields.find((f) => f.status === "ready") ??
    state.fields.find((f) => f.status === "running") ??
    null;
  const isReady = found?.status === "ready";
  $("field-choice").value = found?.field ?? "";
  $("no-field").hidden = Boolean(found);
  if (state.heading !== "best" && !(found?.headings > 1)) set({ heading: "best" });
  set({ field: isReady ? found : null, plan: null, point: null, triplet: null, trouble: [], range: null });
  if (isReady) await chooseRange();
  else if (found?.status === "running") follow(`/v1/jobs/${found.job}`, found.field);
  else if (found?.error) failed(Object.assign(new Error(found.error), { title: "This field failed" }));
  else if (!found && state.tool !== "marks") $("build-box").open = true;
}

function follow(job, field) {
  const map = state.map.map;
  watch(job)
    .then(async (ended) => {
      if (state.map.map !== map) return;
      await loadFields();
      if (ended.status === "successful") {
        await chooseField(field);
        say("The field is ready.");
      } else if (ended.status === "failed") {
        throw Object.assign(new Error(ended.error ?? "The job failed."), { title: "The field was not computed" });
      } else {
        await chooseField(state.field?.field); // the one that is shown
        say("The job was stopped.");
      }
    })
    .catch(failed);
}

export async function order(body) {
  clearTrouble("field-trouble");
  const answer = await sendJson("POST", "/v1/fields", body);
  await loadFields();
  if (answer.job === null || answer.status === "ready") {
    await chooseField(answer.field);
    say("This field was there already.");
    return;
  }
  say("The field is being computed.");
  $("field-choice").value = answer.field;
  follow(answer.links.job, answer.field);
}

// The order that makes a field like the one shown, on another map.
export const sameOrder = (field, map) => ({
  map,
  sensor: field.sensor,
  resolution_m: field.resolution_m,
  heading_rad: field.heading_rad,
  headings: field.headings,
  estimator: field.estimator,
  criterion: field.criterion,
});

const inDegrees = (rad) => String(Number(((rad * 180) / Math.PI).toPrecision(6)));

function fillSensor() {
  const preset = state.facts.presets[$("sensor").value];
  if (preset) {
    $("sensor-kind").value = preset.kind;
    $("max-range").value = preset.max_range_m ?? "";
    $("sigma").value = preset.bearing_sigma_rad ? inDegrees(preset.bearing_sigma_rad) : "0.1";
    $("fov").value = preset.fov_rad ? inDegrees(preset.fov_rad) : "60";
    $("focal").value = preset.focal_px ?? "800";
    $("column").value = preset.column_sigma_px ?? "1";
  }
  $("own-sensor").hidden = Boolean(preset);
  showKind();
}

function showKind() {
  const isCamera = $("sensor-kind").value !== "omnidirectional";
  $("laser-only").hidden = isCamera;
  $("camera-only").hidden = !isCamera;
  showHeadingBoxes(dependsOnHeading());
}

function dependsOnHeading() {
  const { presets, depends_on_heading: names } = state.facts;
  const sensor = $("sensor").value;
  return sensor in presets ? names.includes(sensor) : $("sensor-kind").value === "pinhole_fixed";
}

function orderFromForm() {
  return {
    map: state.map.map,
    sensor: $("sensor").value === "own" ? ownSensor() : $("sensor").value,
    resolution_m: numberIn("resolution") ?? 0.1,
    ...headingsOrdered(dependsOnHeading()),
    criterion: $("criterion").value,
  };
}

function ownSensor() {
  const kind = $("sensor-kind").value;
  const common = { kind, max_range_m: numberIn("max-range") };
  if (kind === "omnidirectional") return { ...common, bearing_sigma_deg: numberIn("sigma") };
  return { ...common, fov_deg: numberIn("fov"), focal_px: numberIn("focal"), column_sigma_px: numberIn("column") };
}
