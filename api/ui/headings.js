// Fields over headings: what of them the map shows, and how many headings an order has.

import { $, numberIn, say } from "./dom.js";
import { degrees } from "./format.js";
import { listen, set, state } from "./state.js";

const REDUCTIONS = ["best", "worst", "mean"];

export function startHeadings() {
  $("headings").max = state.facts.max_headings;
  $("heading-shown").addEventListener("change", () => {
    const wanted = $("heading-shown").value;
    set({ heading: wanted === "angle" ? String(radians(numberIn("heading-angle") ?? 0)) : wanted, range: null });
  });
  $("heading-angle").addEventListener("change", () => {
    const angle = numberIn("heading-angle");
    if (angle === null) say("Type the heading in degrees.");
    else set({ heading: String(radians(angle)), range: null });
  });
  listen(["field", "heading"], show);
}

export const isHeading = (text) => REDUCTIONS.includes(text) || (text !== "" && text !== null && Number.isFinite(Number(text)));

// The heading at which places are asked for; null: the best one there.
export function thetaShown() {
  const { field, heading } = state;
  return field?.headings > 1 && !REDUCTIONS.includes(heading) ? wrapped(Number(heading)) : null;
}

const radians = (angle) => Number(((angle * Math.PI) / 180).toFixed(6));
const wrapped = (rad) => Math.atan2(Math.sin(rad), Math.cos(rad));

function show() {
  const { field, heading } = state;
  const isOver = field?.headings > 1;
  $("heading-row").hidden = !isOver;
  if (!isOver) return;
  const isAngle = !REDUCTIONS.includes(heading);
  $("heading-shown").value = isAngle ? "angle" : heading;
  $("heading-angle-row").hidden = !isAngle;
  if (isAngle) $("heading-angle").value = String(Number(((Number(heading) * 180) / Math.PI).toFixed(2)));
  $("heading-words").textContent = `The field holds ${field.headings} headings, ${degrees((2 * Math.PI) / field.headings)} apart.`;
}

// What an order says of headings, for a sensor to which they matter or not.
export function headingsOrdered(depends) {
  if (!depends) return {};
  const count = numberIn("headings") ?? 1;
  return count > 1 ? { headings: Math.round(count) } : { heading_rad: radians(numberIn("heading") ?? 0) };
}

export function showHeadingBoxes(depends) {
  $("headings-boxes").hidden = !depends;
  $("heading-box").hidden = (numberIn("headings") ?? 1) > 1;
}
