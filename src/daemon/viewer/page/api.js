// The daemon's API, as this page uses it.

/** An answer that is no success: its message and remedy are the daemon's. */
export class Refused extends Error {
  constructor(status, fault) {
    super(fault.message);
    this.status = status;
    this.remedy = fault.remedy ?? "";
  }
}

async function ask(path, options = {}) {
  const answer = await fetch(path, { cache: "no-store", ...options });
  if (answer.ok) return answer;
  const fault = await answer.json().catch(() => ({ message: `the daemon answered ${answer.status}` }));
  throw new Refused(answer.status, fault);
}

const json = (body, headers = {}) => ({
  method: "POST",
  body: JSON.stringify(body),
  headers: { "content-type": "application/json", ...headers },
});

/** Trades the token behind the address's # for a cookie, and takes it out of the address. */
export async function enter() {
  const token = new URLSearchParams(location.hash.slice(1)).get("token");
  if (!token) return;
  history.replaceState(null, "", location.pathname);
  await ask("/login", { method: "POST", body: token });
}

export const status = async () => (await ask("/v1/status")).json();
export const config = async () => (await ask("/v1/config")).json();
export const shots = async (skip, limit) => (await ask(`/v1/shots?skip=${skip}&limit=${limit}`)).json();
export const describe = async (id) => (await ask(`/v1/shots/${id}`)).json();
export const remove = (id) => ask(`/v1/shots/${id}`, { method: "DELETE" });
export const fileAddress = (id, name) => `/v1/shots/${id}/files/${encodeURIComponent(name)}`;

// JPEG: a raw picture of 512 × 512 is a megabyte, which takes a browser longer to hand from process to
// process than to unpack, and a tunnel longer still.
export const viewBlob = async (id, wanted) =>
  (await ask(`/v1/shots/${id}/view`, json({ ...wanted, format: "jpeg" }))).blob();

export const view = async (id, wanted) => createImageBitmap(await viewBlob(id, wanted));

/** What the camera sees, raw, so that clipped pixels can be told; and the frame's number. */
export async function preview(device, after) {
  const answer = await ask(`/v1/devices/${device}/preview?format=raw&after=${after}`);
  const width = Number(answer.headers.get("x-width"));
  const height = Number(answer.headers.get("x-height"));
  const bytes = new Uint8ClampedArray(await answer.arrayBuffer());
  return { image: new ImageData(bytes, width, height), number: Number(answer.headers.get("x-frame")) };
}

/** Does what takes a while; `step` hears how far it is. Resolves with the shot. */
async function underway(path, body, step) {
  const answer = await ask(path, json(body, { accept: "text/event-stream" }));
  for await (const { event, data } of events(answer.body)) {
    if (event === "step") step(data);
    else if (event === "done") return JSON.parse(data);
    else if (event === "failed") throw new Refused(0, JSON.parse(data));
  }
  throw new Error("the daemon went away before the shot was safe");
}

export const shoot = (body, step) => underway("/v1/shots", body, step);
export const relight = (id, body, step) => underway(`/v1/shots/${id}/relight`, body, step);

/** Server-sent events of a body. */
async function* events(body) {
  let text = "";
  const reader = body.pipeThrough(new TextDecoderStream()).getReader();
  for (;;) {
    const { value, done } = await reader.read();
    if (done) return;
    text += value;
    for (let end; (end = text.indexOf("\n\n")) >= 0; text = text.slice(end + 2)) {
      const found = { event: "message", data: "" };
      for (const line of text.slice(0, end).split("\n")) {
        const [, name, rest] = line.match(/^(\w+): ?(.*)$/) ?? [];
        if (name === "event") found.event = rest;
        else if (name === "data") found.data += rest;
      }
      yield found;
    }
  }
}

/** Calls `heard` with everything that happens; `state` hears whether the daemon is there. */
export function listen(heard, state) {
  const source = new EventSource("/v1/events");
  source.onmessage = (message) => heard(JSON.parse(message.data));
  source.onopen = () => state(true);
  source.onerror = () => state(false);
}
