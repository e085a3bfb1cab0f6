// The colour bar: the ramp, round ticks in the metric's unit, what hatching and stripes mean.

import { $, svg } from "./dom.js";
import { degrees, significant, ticks } from "./format.js";
import { listen, state } from "./state.js";

const LEFT = 12;
const WIDTH = 250;
const STRIPES = 64;
const DIGIT = 6.5; // width of one in a label, px

export function startBar() {
  listen(["facts", "field", "range", "metric", "scale", "colormap", "heading"], paint);
}

function paint() {
  const { facts, field, range, metric, scale, colormap } = state;
  $("bar").hidden = !(facts && field && range);
  if ($("bar").hidden) return;
  const [low, high] = range;
  const { unit, meaning } = facts.metrics[metric];
  const name = metric.replace(/_(m2|m|rad)$/, "");
  const table = facts.colormaps[colormap];
  const parts = [];
  for (let k = 0; k < STRIPES; k += 1) {
    const index = Math.round((255 * k) / (STRIPES - 1));
    const fill = `#${table.slice(6 * index, 6 * index + 6)}`;
    parts.push(svg("rect", { x: LEFT + (WIDTH * k) / STRIPES, y: 2, width: WIDTH / STRIPES + 0.6, height: 13, fill }));
  }
  let taken = 0; // up to here, by the labels before
  for (const value of ticks(low, high, scale)) {
    const t = scale === "log" ? Math.log(value / low) / Math.log(high / low) : (value - low) / (high - low);
    const x = LEFT + WIDTH * t;
    parts.push(svg("line", { x1: x, x2: x, y1: 15, y2: 19, class: "axis" }));
    const words = plain(value);
    const half = (DIGIT * words.length) / 2;
    const middle = Math.min(Math.max(x, half), LEFT + WIDTH + LEFT - half); // inside the picture
    if (middle - half < taken) continue;
    taken = middle + half + DIGIT;
    const text = svg("text", { x: middle, y: 30, class: "tick", "text-anchor": "middle" });
    text.textContent = words;
    parts.push(text);
  }
  $("bar-title").textContent = unit ? `${name} [${unit}]` : name;
  $("bar-meaning").textContent = `Colours: ${meaning}${over()}.`;
  $("bar-ramp").replaceChildren(...parts);
  $("bar-ramp").setAttribute("aria-label", `Colours: ${meaning}, from ${significant(low)} to ${significant(high)} ${unit}`);
}

// Of a field over headings.
function over() {
  const { field, heading } = state;
  if (!(field.headings > 1)) return "";
  if (heading === "best" || heading === "worst") return `, at the ${heading} heading`;
  return heading === "mean" ? ", mean over the headings with a fix" : `, at the heading ${degrees(Number(heading))}`;
}

// 0.0030 is 0.003 on an axis.
function plain(value) {
  const text = significant(value, 2);
  return text.includes("⁻") || !text.includes(".") ? text : text.replace(/\.?0+$/, "");
}
