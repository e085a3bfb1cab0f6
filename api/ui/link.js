// The permalink: what is shown, in the hash of the address.

import { listen, state } from "./state.js";
import { view } from "./map_view.js";

const WAIT_MS = 250;
let timer;

export function readLink() {
  const given = new URLSearchParams(location.hash.slice(1));
  const numbers = (key, count) => {
    const found = (given.get(key) ?? "").split(",").map(Number);
    return given.has(key) && found.length === count && found.every(Number.isFinite) ? found : null;
  };
  const place = (key) => {
    const found = numbers(key, 2);
    return found && { x: found[0], y: found[1] };
  };
  const seen = numbers("view", 3);
  return {
    map: given.get("map"),
    field: given.get("field"),
    heading: given.get("heading"),
    metric: given.get("metric"),
    scale: given.get("scale"),
    colormap: given.get("colors"),
    opacity: numbers("opacity", 1)?.[0],
    range: numbers("range", 2),
    view: seen && { x: seen[0], y: seen[1], scale: Math.min(5000, Math.max(0.01, seen[2])) },
    place: place("place"),
    start: place("start"),
    goal: place("goal"),
    controls: new URLSearchParams(given.get("plan") ?? ""),
  };
}

// controls(): the plan's controls that differ from what they were, as a query
export function keepLink(controls) {
  const keys = ["map", "field", "heading", "metric", "scale", "colormap", "opacity", "low", "high", "view", "place", "start", "goal", "plan"];
  listen(keys, () => {
    clearTimeout(timer);
    timer = setTimeout(() => history.replaceState(null, "", `#${write(controls())}`), WAIT_MS);
  });
}

function write(controls) {
  const pair = (p) => p && `${p.x.toFixed(3)},${p.y.toFixed(3)}`;
  const wanted = {
    map: state.map?.map,
    field: state.field?.field,
    heading: state.field?.headings > 1 ? state.heading : null,
    metric: state.metric,
    scale: state.scale,
    colors: state.colormap,
    opacity: state.opacity,
    range: state.low !== null && state.high !== null ? `${state.low},${state.high}` : null,
    view: `${view.x.toFixed(3)},${view.y.toFixed(3)},${view.scale.toPrecision(5)}`,
    place: pair(state.place),
    start: pair(state.start),
    goal: pair(state.goal),
    plan: controls,
  };
  // Commas stay commas: people read addresses.
  return new URLSearchParams(Object.entries(wanted).filter(([, value]) => value)).toString().replaceAll("%2C", ",");
}
