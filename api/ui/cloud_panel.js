// Fixes simulated at the place that was asked for: how many lie inside the predicted ellipse.

import { $, make, say } from "./dom.js";
import { metres, percent } from "./format.js";
import { sendJson } from "./http.js";
import { listen, set, state } from "./state.js";
import { clearTrouble, showTrouble } from "./troubles.js";

const FIXES = 2000;
const POINTS = 1000; // of them drawn
const FAILURES = { no_pose: "without a pose that fits", outside_image: "outside the image" };

export function startClouds() {
  $("simulate").addEventListener("click", simulate);
  listen(["point", "triplet"], () => {
    clearTrouble("cloud-trouble");
    set({ cloud: null });
  });
  listen(["cloud", "point", "triplet"], show);
}

// At the middle of the cell, with the triplet that is shown: the ellipse in the picture is the one that is tested.
async function simulate() {
  const { field, point, triplet } = state;
  const { place } = point.ranking;
  const isOfAll = field.estimator === "all_visible" && !triplet;
  const question = {
    field: field.field,
    pose: { ...place, theta_rad: point.heading_rad },
    n: FIXES,
    points: POINTS,
    ...(isOfAll ? {} : { triplet: triplet?.triplet ?? point.triplet, estimator: "best_triplet" }),
  };
  clearTrouble("cloud-trouble");
  $("simulate").disabled = true;
  try {
    const cloud = await sendJson("POST", "/v1/fixes", question);
    if (state.point !== point || state.triplet !== triplet) return;
    set({ cloud });
    $("cloud-words").scrollIntoView({ block: "nearest" });
    say(words(cloud));
  } catch (error) {
    showTrouble("cloud-trouble", error);
  } finally {
    $("simulate").disabled = false;
  }
}

function words(cloud) {
  if (cloud.share_inside === null) return cloud.reason;
  const predicted = cloud.predicted_share === null ? "" : `, predicted ${percent(cloud.predicted_share)}`;
  const inside = `${percent(cloud.share_inside)} of ${cloud.n} simulated fixes lie inside the ellipse${predicted}.`;
  return cloud.reason && cloud.valid === null ? `${inside} ${cloud.reason}` : inside;
}

function show() {
  const { cloud, point, triplet } = state;
  $("simulate").hidden = !point?.ranking || !(triplet ? !triplet.blocking : point.state === "fix");
  $("cloud-words").textContent = cloud ? words(cloud) : "";
  const found = cloud?.share_inside === null || !cloud ? [] : rows(cloud);
  $("cloud-rows").replaceChildren(
    ...found.map(([name, value]) => make("tr", {}, make("th", { scope: "row", textContent: name }), make("td", { textContent: value }))),
  );
}

function rows({ predicted, sample, bias, failures }) {
  const axes = (spread) => (spread ? `${metres(spread.ellipse95.a_m)} × ${metres(spread.ellipse95.b_m)}` : "–");
  const failed = Object.entries(failures).map(([status, count]) => `${count} ${FAILURES[status] ?? status.replaceAll("_", " ")}`);
  return [
    ["Semi-axes, simulated", axes(sample)],
    ["Semi-axes, predicted", axes(predicted)],
    ["Mean error", bias.x_m === null ? "–" : metres(Math.hypot(bias.x_m, bias.y_m))],
    ["Without a fix", failed.join(", ")],
  ].filter(([, value]) => value && value !== "–");
}
