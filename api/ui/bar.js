// The colour bar: the ramp, round ticks in the metric's unit, what hatching and stripes mean.

import { $, svg } from "./dom.js";
import { significant, ticks } from "./format.js";
import { listen, state } from "./state.js";

const LEFT = 12;
const WIDTH = 250;
const STRIPES = 64;

export function startBar() {
  listen(["facts", "field", "range", "metric", "scale", "colormap"], paint);
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
  for (const value of ticks(low, high, scale)) {
    const t = scale === "log" ? Math.log(value / low) / Math.log(high / low) : (value - low) / (high - low);
    const x = LEFT + WIDTH * t;
    parts.push(svg("line", { x1: x, x2: x, y1: 15, y2: 19, class: "axis" }));
    const text = svg("text", { x, y: 30, class: "tick", "text-anchor": "middle" });
    text.textContent = plain(value);
    parts.push(text);
  }
  $("bar-title").textContent = unit ? `${name} [${unit}]` : name;
  $("bar-title").title = meaning;
  $("bar-ramp").replaceChildren(...parts);
  $("bar-ramp").setAttribute("aria-label", `Colours: ${meaning}, from ${significant(low)} to ${significant(high)} ${unit}`);
}

// 0.0030 is 0.003 on an axis.
function plain(value) {
  const text = significant(value, 2);
  return text.includes("⁻") || !text.includes(".") ? text : text.replace(/\.?0+$/, "");
}
