// Requests to the service, and its problems in words.

export class Problem extends Error {
  // document: RFC 9457 members, or nothing where the service could not be reached.
  constructor(status, document, retryAfter = null) {
    super((document.detail ?? "").replaceAll("#/", "") || document.title || `The service answered ${status}.`);
    this.status = status;
    this.title = document.title || "The service answered with an error";
    this.code = document.code || "";
    this.hint = document.hint || {};
    this.retryAfter = retryAfter; // s
    this.limit = document.setting ? `${document.setting} sets this limit.` : "";
  }
}

const KEY = "surepath-key"; // of this tab only: gone when it is closed

function withKey(headers) {
  const key = sessionStorage.getItem(KEY);
  return key ? { ...headers, "X-API-Key": key } : headers;
}

export function keepKey(key) {
  if (key) sessionStorage.setItem(KEY, key);
  else sessionStorage.removeItem(KEY);
}

export async function ask(path, { method = "GET", body, headers = {}, signal } = {}) {
  let answer;
  try {
    answer = await fetch(path, { method, body, headers: withKey(headers), signal });
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw new Problem(0, { title: "No answer", detail: "The service cannot be reached; is it still running?" });
  }
  if (answer.ok) return answer;
  let document = {};
  try {
    document = await answer.json();
  } catch {
    // A proxy's own error page; the status is all that is known.
  }
  throw new Problem(answer.status, document, Number(answer.headers.get("Retry-After")) || null);
}

// A service that is busy says when to come again: it has just started, say, and reads a field.
export async function whenFree(act, waiting, tries = 4) {
  for (let left = tries; ; left -= 1) {
    try {
      return await act();
    } catch (error) {
      if (error.status !== 503 || !error.retryAfter || left <= 1) throw error;
      waiting(error);
      await new Promise((resolve) => setTimeout(resolve, 1000 * error.retryAfter));
    }
  }
}

export const getJson = async (path, options) => (await ask(path, options)).json();

export async function sendJson(method, path, value, headers = {}) {
  const answer = await ask(path, {
    method,
    body: JSON.stringify(value),
    headers: { "Content-Type": "application/json", ...headers },
  });
  return answer.json();
}

export const getPicture = async (path, options) => createImageBitmap(await (await ask(path, options)).blob());

// A plain link sends no key; where one is needed, files are fetched with it and then handed over.
export function sendKeyWithDownloads(links, failed) {
  for (const link of links) {
    link.addEventListener("click", async (event) => {
      if (!sessionStorage.getItem(KEY) || link.href.startsWith("blob:")) return;
      event.preventDefault();
      const address = link.href;
      try {
        const content = URL.createObjectURL(await (await ask(address)).blob());
        link.href = content;
        link.click();
        link.href = address;
        URL.revokeObjectURL(content);
      } catch (error) {
        failed(error);
      }
    });
  }
}

export function query(values) {
  const kept = Object.entries(values).filter(([, value]) => value !== null && value !== undefined && value !== "");
  return new URLSearchParams(kept).toString();
}
