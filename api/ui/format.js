// Numbers with their units, as people read them.

const SUPERSCRIPT = "⁰¹²³⁴⁵⁶⁷⁸⁹";

export function significant(value, digits = 3) {
  if (value === 0) return "0";
  const size = Math.floor(Math.log10(Math.abs(value)));
  if (size < -3 || size > 5) return powerOfTen(value, digits);
  return value.toFixed(Math.min(12, Math.max(0, digits - 1 - size)));
}

function powerOfTen(value, digits) {
  const [mantissa, exponent] = value.toExponential(digits - 1).split("e");
  const raised = [...exponent].map((sign) => (sign === "-" ? "⁻" : (SUPERSCRIPT[sign] ?? ""))).join("");
  const front = String(Number(mantissa));
  return front === "1" ? `10${raised}` : `${front}·10${raised}`;
}

export function metres(value) {
  if (value === null || value === undefined) return "–";
  if (value !== 0 && Math.abs(value) < 1) return `${significant(1000 * value)} mm`;
  return `${significant(value)} m`;
}

// Lengths of ways and rooms: millimetres would say more than is known.
export const way = (value) => (value === null || value === undefined ? "–" : `${value.toFixed(2)} m`);

export function squareMetres(value) {
  if (value === null || value === undefined) return "–";
  return value < 0.01 ? `${significant(1e4 * value)} cm²` : `${significant(value)} m²`;
}

export const degrees = (rad) => (rad === null || rad === undefined ? "–" : `${significant((rad * 180) / Math.PI)}°`);

export const seconds = (value) => (value === null || value === undefined ? "–" : `${value.toFixed(1)} s`);

export function probability(value) {
  if (value === null || value === undefined) return "–";
  if (value < 1e-9) return "< 10⁻⁹";
  return significant(value, 2);
}

export const percent = (share) => (share === null || share === undefined ? "–" : `${(100 * share).toFixed(1)} %`);

export function inUnit(value, unit) {
  if (value === null || value === undefined) return "–";
  if (unit === "m²") return squareMetres(value);
  if (unit === "m") return metres(value);
  if (unit === "rad") return degrees(value);
  return Number.isInteger(value) ? String(value) : significant(value);
}

export const place = (p) => `(${p.x.toFixed(2)}, ${p.y.toFixed(2)})`;

// Round numbers for an axis or a colour bar, at most about eight.
export function ticks(low, high, scale) {
  if (scale === "log") {
    let found = [];
    for (const steps of [[1, 2, 5], [1, 3], [1]]) {
      found = [];
      for (let d = Math.floor(Math.log10(low)); d <= Math.ceil(Math.log10(high)); d += 1) {
        for (const m of steps) {
          const value = Number(`${m}e${d}`);
          if (value >= low && value <= high * (1 + 1e-9)) found.push(value);
        }
      }
      if (found.length <= 8) break;
    }
    return found.length > 1 ? found : [low, high];
  }
  const raw = (high - low) / 6;
  const base = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((m) => m * base).find((s) => s >= raw);
  const found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high * (1 + 1e-9); k += 1) found.push(k * step);
  return found;
}
