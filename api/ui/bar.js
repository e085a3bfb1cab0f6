// The colour bar: the ramp, round ticks in the metric's unit, what hatching and stripes mean.

import { $, svg } from "./dom.js";
import { significant, ticks } from "./format.js";
import { listen, state } from "./state.js";

const HEIGHT = 190;
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
    const index = Math.round((255 * (STRIPES - 1 - k)) / (STRIPES - 1));
    const fill = `#${table.slice(6 * index, 6 * index + 6)}`;
    const y = 8 + (HEIGHT * k) / STRIPES;
    parts.push(svg("rect", { x: 0, y, width: 16, height: HEIGHT / STRIPES + 0.6, fill }));
  }
  for (const value of ticks(low, high, scale)) {
    const t = scale === "log" ? Math.log(value / low) / Math.log(high / low) : (value - low) / (high - low);
    const y = 8 + HEIGHT * (1 - t);
    parts.push(svg("line", { x1: 16, x2: 21, y1: y, y2: y, class: "axis" }));
    const text = svg("text", { x: 25, y: y + 4, class: "tick" });
    text.textContent = significant(value, 2).replace(/(\.\d*?)0+$/, "$1").replace(/\.$/, "");
    parts.push(text);
  }
  $("bar-title").textContent = unit ? `${name} [${unit}]` : name;
  $("bar-title").title = meaning;
  $("bar-ramp").replaceChildren(...parts);
  $("bar-ramp").setAttribute("aria-label", `Colours: ${meaning}, from ${significant(low)} to ${significant(high)} ${unit}`);
}
