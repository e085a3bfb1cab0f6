// Elements by id, elements made, text written: no HTML is ever put together from strings.

export const $ = (id) => document.getElementById(id);

export function make(tag, properties = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (name in element) element[name] = value;
    else element.setAttribute(name, value);
  }
  element.append(...children.filter((child) => child !== null && child !== undefined));
  return element;
}

export function svg(tag, attributes = {}, ...children) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.append(...children);
  return element;
}

export function fillSelect(select, options, chosen) {
  select.replaceChildren(...options.map(([value, text]) => make("option", { value, textContent: text })));
  if (options.some(([value]) => value === chosen)) select.value = chosen;
}

// A number typed by a person; null where the box is empty or holds none.
export function numberIn(id) {
  const text = $(id).value.trim().replace(",", ".");
  const value = Number(text);
  return text === "" || !Number.isFinite(value) ? null : value;
}

// A word on the map while something takes longer than people wait without one.
const BUSY_MS = 350;
let pending = 0;
export async function busy(promise) {
  pending += 1;
  setTimeout(() => ($("busy").hidden = !pending), BUSY_MS);
  try {
    return await promise;
  } finally {
    pending -= 1;
    if (!pending) $("busy").hidden = true;
  }
}

export function say(text) {
  $("said").textContent = text;
}
