// The page: one shot on the stage, a light to drag over it, and the list of all shots.

import * as api from "./api.js";
import { SKIES, lightsOf, readHdr } from "./environments.js";
import { Hemisphere } from "./hemisphere.js";
import { histogram, isClipped, look } from "./live.js";
import { Picture } from "./picture.js";

const $ = (id) => document.getElementById(id);
const LAYERS = {
  relit: "Relit", flash: "Flash", ambient: "No flash", albedo: "Albedo", normals: "Normals",
  roughness: "Roughness", shadow: "Shadow", depth: "Depth", confidence: "Confidence",
};
const PAGE = 24; // shots of the list that are loaded at once

const state = {
  shot: null, layer: "relit", sky: null, turn: 0, skies: { ...SKIES },
  listed: 0, stopLive: null, role: "look", devices: [],
};

// ---- what is said

let forget;
function say(words, mild = false) {
  clearTimeout(forget);
  $("notice").textContent = words;
  $("notice").className = mild ? "mild" : "";
  $("notice").hidden = !words;
  if (mild) forget = setTimeout(() => say(""), 4000);
}
const fail = (error) => say(error.remedy ? `${error.message}. ${error.remedy}.` : error.message);

function busy(words) {
  $("busy").hidden = !words;
  $("busy-words").textContent = words ?? "";
}

// ---- the picture: always the newest wish; one picture is worked out while the last one is on its way

const picture = new Picture($("picture"), $("overlay"), $("divider"), [$("tag-before"), $("tag-after")]);
let asking = 0;
let asked = 0;
let shown = 0;
let wish = false;
const drawn = [];

const detail = () => ($("full").checked ? "full" : "quick");

/** What is wanted of the daemon now. */
function wanted() {
  const strength = Number($("brightness").value);
  const warmth = Number($("warmth").value);
  const color = [1 + 0.45 * warmth, 1, 1 - 0.6 * warmth].map((value) => Math.max(0, value * strength));
  const lights = strength > 0 ? [{ direction: hemisphere.direction, intensity: color }] : [];
  const around = state.sky && lightsOf(state.skies[state.sky], state.turn);
  return {
    layer: state.layer,
    detail: detail(),
    lights,
    ...(around ? { environment: { name: state.sky, lights: around } } : {}),
  };
}

async function refresh() {
  if (!state.shot || state.stopLive) return;
  wish = true;
  if (asking >= 2) return;
  document.body.dataset.asking = ++asking;
  try {
    while (wish) {
      wish = false;
      const shot = state.shot;
      const number = ++asked;
      const began = performance.now();
      const image = await api.view(shot, wanted());
      if (number < shown || shot !== state.shot || state.stopLive) continue;
      shown = number;
      picture.show(image);
      figures(image, performance.now() - began);
    }
  } catch (error) {
    fail(error);
  } finally {
    document.body.dataset.asking = --asking;
  }
}

function figures(image, milliseconds) {
  const now = performance.now();
  drawn.push(now);
  while (drawn[0] < now - 1000) drawn.shift();
  $("size").textContent = `${image.width} × ${image.height}`;
  $("rate").textContent = drawn.length > 3 ? `${drawn.length} pictures/s` : `${milliseconds.toFixed(0)} ms`;
  document.body.dataset.drawn = Number(document.body.dataset.drawn ?? 0) + 1;
}

const hemisphere = new Hemisphere($("hemisphere"), $("direction"), () => {
  if (state.shot && !["relit", "shadow"].includes(state.layer)) choose($("layers"), "relit");
  refresh();
});

// Dragging on the picture itself: the light follows as on the half sphere.
$("picture").addEventListener("pointerdown", (event) => {
  if (state.stopLive || !state.shot) return;
  $("picture").setPointerCapture(event.pointerId);
  dragTo(event);
});
$("picture").addEventListener("pointermove", (event) => {
  if ($("picture").hasPointerCapture(event.pointerId)) dragTo(event);
});
function dragTo(event) {
  const box = $("picture").getBoundingClientRect();
  hemisphere.set(2 * ((event.clientX - box.left) / box.width) - 1, 1 - 2 * ((event.clientY - box.top) / box.height));
}
$("picture").addEventListener("keydown", (event) => {
  if (event.key.startsWith("Arrow") || event.key === "Home") {
    $("hemisphere").dispatchEvent(new KeyboardEvent("keydown", { key: event.key, shiftKey: event.shiftKey, cancelable: true }));
    event.preventDefault();
  }
});

// ---- chips: one of several

function chips(box, name, entries, changed) {
  box.replaceChildren(...entries.map(([value, words]) => {
    const label = document.createElement("label");
    const input = Object.assign(document.createElement("input"), { type: "radio", name, value });
    input.addEventListener("change", () => changed(value));
    label.append(input, words);
    return label;
  }));
}
function choose(box, value) {
  const input = [...box.querySelectorAll("input")].find((found) => found.value === value);
  if (input && !input.checked) {
    input.checked = true;
    input.dispatchEvent(new Event("change"));
  }
}

chips($("layers"), "layer", Object.entries(LAYERS), (layer) => {
  state.layer = layer;
  leaveLive();
  refresh();
});

function skyChips() {
  chips($("environments"), "sky", [["", "None"], ...Object.keys(state.skies).map((name) => [name, name])], (name) => {
    state.sky = name || null;
    $("turn").disabled = !name;
    if (name && !["relit", "shadow"].includes(state.layer)) choose($("layers"), "relit");
    // A sky is looked at by itself first; the lamp comes back with its brightness.
    $("brightness").value = name ? 0 : 1;
    refresh();
  });
}
skyChips();
$("turn").addEventListener("input", () => {
  state.turn = Number($("turn").value);
  refresh();
});
$("map-file").addEventListener("change", async () => {
  const [file] = $("map-file").files;
  if (!file) return;
  try {
    state.skies[file.name] = readHdr(await file.arrayBuffer());
    skyChips();
    choose($("environments"), file.name);
  } catch (error) {
    fail(error);
  }
});
for (const id of ["brightness", "warmth"]) $(id).addEventListener("input", refresh);

$("full").addEventListener("change", async () => {
  busy("developing for the light table…");
  await refresh();
  await compare();
  busy();
});

$("compare").addEventListener("change", compare);
async function compare() {
  if (!$("compare").checked || !state.shot) return picture.compare(null);
  try {
    picture.compare(await api.view(state.shot, { layer: "flash", detail: detail() }));
  } catch (error) {
    fail(error);
  }
}

// ---- live

function leaveLive() {
  if (!state.stopLive) return;
  state.stopLive();
  state.stopLive = null;
  picture.mark();
  $("live-box").hidden = true;
  $("to-live").setAttribute("aria-pressed", "false");
  for (const id of ["light-box", "environment-box", "layer-box", "actions"]) $(id).hidden = false;
  $("about-shot").hidden = !state.shot;
  $("empty").hidden = Boolean(state.shot);
}

function live() {
  if (state.stopLive) {
    leaveLive();
    return refresh();
  }
  picture.compare(null);
  $("compare").checked = false;
  $("empty").hidden = true;
  $("live-box").hidden = false;
  for (const id of ["light-box", "environment-box", "layer-box", "actions", "about-shot"]) $(id).hidden = true;
  $("to-live").setAttribute("aria-pressed", "true");
  const show = (image) => {
    const shown = new ImageData(image.data.map((value, at) => (at % 4 === 3 ? 255 : value)), image.width, image.height);
    picture.after = shown;
    picture.draw();
    const share = histogram($("histogram"), image);
    $("clipped").textContent = share > 0 ? `${(100 * share).toFixed(1)} % of the picture is clipped` : "nothing is clipped";
    picture.mark($("zebra").checked ? image : null, isClipped);
    figures(image, 0);
  };
  state.stopLive = look(0, show, fail);
}
$("to-live").addEventListener("click", live);

// ---- shots

async function list(fresh = true) {
  if (fresh) state.listed = 0;
  const { count, shots } = await api.shots(state.listed, PAGE);
  state.listed += shots.length;
  $("count").textContent = count ? `(${count})` : "";
  $("more").hidden = state.listed >= count;
  const entries = shots.map((shot) => {
    const item = document.createElement("li");
    const button = Object.assign(document.createElement("button"), { type: "button" });
    const image = Object.assign(document.createElement("img"), { alt: "", loading: "lazy" });
    const caption = document.createElement("span");
    caption.className = "caption";
    const when = new Date(shot.at_ms);
    const time = when.toLocaleTimeString([], { hour: "2-digit", minute: "2-digit", second: "2-digit" });
    const day = when.toDateString() === new Date().toDateString() ? "" : `${when.toLocaleDateString()} `;
    caption.textContent = `${day}${time}${shot.source.startsWith("shot-") ? " · relit again" : ""}`;
    button.append(image, caption);
    button.dataset.id = shot.id;
    button.title = `${shot.id}, ${shot.source}`;
    button.addEventListener("click", () => open(shot.id));
    if (small.has(shot.id)) image.src = small.get(shot.id);
    else seen.observe(button);
    item.append(button);
    return item;
  });
  if (fresh) $("shots").replaceChildren(...entries);
  else $("shots").append(...entries);
  current();
  return shots;
}

// Small pictures are made by the daemon one after the other, and only of what is on the screen.
const seen = new IntersectionObserver((changes) => {
  for (const { target, isIntersecting } of changes) {
    if (!isIntersecting) continue;
    seen.unobserve(target);
    thumbnails = thumbnails.then(() => thumbnail(target)).catch(() => {});
  }
});
let thumbnails = Promise.resolve();
const small = new Map(); // addresses of the small pictures, by shot
async function thumbnail(button) {
  const { id } = button.dataset;
  const manifest = await api.describe(id);
  const name = manifest.lights[0]?.relit_png;
  const blob = name
    ? await (await fetch(api.fileAddress(id, name))).blob()
    : await api.viewBlob(id, { layer: "flash" });
  const bitmap = await createImageBitmap(blob, { resizeWidth: 320, resizeQuality: "medium" });
  const canvas = new OffscreenCanvas(bitmap.width, bitmap.height);
  canvas.getContext("2d").drawImage(bitmap, 0, 0);
  small.set(id, URL.createObjectURL(await canvas.convertToBlob({ type: "image/jpeg", quality: 0.85 })));
  button.querySelector("img").src = small.get(id);
}

function current() {
  for (const button of $("shots").querySelectorAll("button")) {
    button.setAttribute("aria-current", String(button.dataset.id === state.shot));
  }
}

async function open(id) {
  leaveLive();
  state.shot = id;
  $("empty").hidden = Boolean(id);
  current();
  about(id);
  if (!id) return;
  busy("developing for the light table…");
  await refresh();
  await compare();
  busy();
}

async function about(id) {
  const shows = (box, items) => $(box).replaceChildren(...items);
  $("about-shot").hidden = !id;
  if (!id) return;
  try {
    const manifest = await api.describe(id);
    $("made-of").textContent = burstWords(manifest.report.burst);
    shows("warnings", manifest.warnings.map((words) => Object.assign(document.createElement("li"), { textContent: words })));
    shows("files", [...manifest.files.map((file) => file.name), "shot.json"].map((name) => {
      const item = document.createElement("li");
      const link = Object.assign(document.createElement("a"), { href: api.fileAddress(id, name), textContent: name, download: name });
      item.append(link);
      return item;
    }));
  } catch (error) {
    fail(error);
  }
}

/** Of what a burst was made; nothing of a shot that is none. */
function burstWords(burst) {
  if (!burst) return "";
  const [flash, ambient] = burst.used;
  return `${flash} frames with flash and ${ambient} without: ${burst.expected_noise.toFixed(2)} of the noise of one and one.`;
}

async function finish(work) {
  if (state.role !== "shoot") return;
  $("shoot").disabled = $("keep").disabled = true;
  try {
    const reply = await work((words) => busy(`${words}…`));
    say(reply.warnings[0] ? `Kept. ${reply.warnings[0]}` : "Kept.", true);
    await list();
    await open(reply.id);
  } catch (error) {
    fail(error);
  } finally {
    busy();
    roles();
  }
}

function shoot() {
  const frames = $("burst");
  // The browser tells what is wrong beside the field, and nothing is shot by mistake.
  if (!frames.reportValidity()) return;
  leaveLive();
  const burst = frames.value ? { burst: Number(frames.value) } : {};
  return finish((step) => api.shoot({ relight: true, lights: [{ direction: hemisphere.direction }], ...burst }, step));
}
$("shoot").addEventListener("click", shoot);
$("burst").addEventListener("keydown", (event) => {
  if (event.key === "Enter") $("shoot").click();
});
$("keep").addEventListener("click", () => {
  const { lights, environment } = wanted();
  return finish((step) => api.relight(state.shot, { lights, ...(environment ? { environment } : {}) }, step));
});
$("more").addEventListener("click", () => list(false).catch(fail));

$("save").addEventListener("click", async () => {
  try {
    busy("at full size…");
    const blob = await api.viewBlob(state.shot, { ...wanted(), detail: "full" });
    const link = Object.assign(document.createElement("a"), {
      href: URL.createObjectURL(blob), download: `${state.shot}-${state.layer}.jpg`,
    });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  } catch (error) {
    fail(error);
  } finally {
    busy();
  }
});

$("delete").addEventListener("click", () => {
  $("doomed").textContent = state.shot;
  $("confirm").showModal();
});
$("confirm").addEventListener("close", async () => {
  if ($("confirm").returnValue !== "yes") return;
  try {
    await api.remove(state.shot);
    URL.revokeObjectURL(small.get(state.shot));
    small.delete(state.shot);
    const shots = await list();
    await open(shots[0]?.id ?? null);
  } catch (error) {
    fail(error);
  }
});

// ---- the daemon

function roles() {
  const may = state.role === "shoot";
  $("shoot").disabled = $("burst").disabled = !may;
  $("keep").disabled = $("delete").disabled = !may || !state.shot;
  $("save").disabled = !state.shot;
}

function device(phase, words) {
  document.querySelector("#device .dot").className = `dot ${phase}`;
  $("device-words").textContent = words;
}

/** How many frames a burst may have. */
async function limits() {
  $("burst").max = (await api.config()).limits.burst;
}

async function status() {
  const found = await api.status();
  state.role = found.role;
  state.devices = found.devices;
  const [first] = found.devices;
  device(first.phase, first.problem ?? `${first.device.model} · ${first.phase}`);
  roles();
}

function heard(event) {
  if (event.event === "device") status().catch(fail);
  else if (event.event === "reloaded") limits().catch(fail);
  else if (event.event === "committed" || event.event === "deleted") list().catch(fail);
}

document.addEventListener("keydown", (event) => {
  if (event.target.matches("input, dialog *") || event.ctrlKey || event.metaKey || event.altKey) return;
  if (event.key === "s") $("shoot").click();
  else if (event.key === "l") $("to-live").click();
  else if (event.key === "b") $("compare").click();
});

try {
  await api.enter();
  await status();
  await limits();
  choose($("environments"), "");
  choose($("layers"), "relit");
  const shots = await list();
  await open(shots[0]?.id ?? null);
  roles();
  api.listen(heard, (there) => {
    if (there) status().catch(fail);
    else device("away", "the daemon does not answer; trying again…");
  });
} catch (error) {
  device("away", "no connection");
  fail(error);
}
document.body.dataset.ready = "true";
