// What the page shows, in one place; whoever changes it says so, whoever draws it listens.

export const state = {
  facts: null, // colour tables, metrics, presets: from facts.json
  maps: [],
  map: null, // as /v1/maps/{m} tells it
  marks: [], // landmarks as shown; differ from the map's while they are edited
  marksTag: null, // ETag under which the landmarks were read
  marksRead: [], // as they were read
  edited: false,
  adding: false, // the next click on the map is where a landmark stands
  mark: null, // index of the landmark that is selected
  fields: [],
  field: null,
  job: null,
  metric: "area95_m2",
  scale: "log",
  colormap: "viridis",
  opacity: 0.85,
  heading: "best", // of a field over headings: best, worst, mean, or an angle in rad
  range: null, // ends of the colours that are shown
  low: null, // ends of the colours that somebody typed
  high: null,
  tool: "path",
  cursor: null, // of the keyboard, in the map
  place: null, // that was asked for: {x, y}
  point: null, // what the service said of it
  triplet: null, // shown instead of the best one: a row of the ranking
  cloud: null, // fixes simulated at the place
  start: null,
  goal: null,
  plan: null,
  route: 0,
  along: null, // metres along the routes, under the pointer in the profile
  trouble: [], // places where a bound is not kept
};

const listeners = [];

export function listen(keys, act) {
  listeners.push([keys, act]);
}

export function set(changes) {
  Object.assign(state, changes);
  for (const [keys, act] of listeners) if (keys.some((key) => key in changes)) act();
}
