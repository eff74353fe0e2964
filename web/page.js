// Shows a session of the engine (lightsheaf_web.js) and tells it what the controls say. Inputs only note what is wanted;
// one loop brings it about between two batches, since a session does one thing at a time.
//
// The address may name what to show: ?scene=cornell_area&method=path&visibility=bvh&size=320x240&bounces=4&samples=16&seed=0.
// With &post=PATH the finished picture goes to that path of the page's own host as EXR, which the tests ask for.

import start, { Session, scene_names } from "./lightsheaf_web.js";

const at = id => document.getElementById(id);
const canvas = at("picture"), context = canvas.getContext("2d");
const address = new URLSearchParams(location.search);
const controls = ["scene", "method", "visibility", "size", "bounces", "samples", "seed"];
// Milliseconds that a batch should take, so that the page stays responsive.
const BATCH = 150;

// What is wanted and not done yet.
const wanted = { file: null, beside: [], scene: true, settings: true, camera: [], draw: false, reference: null, action: null };
let changed = true, wake = () => {};
const want = change => { Object.assign(wanted, change); changed = true; wake(); };
const change = () => changed ? null : new Promise(resolve => { wake = resolve; });

function say(text, wrong = false) {
  at("status").textContent = text;
  at("status").className = wrong ? "wrong" : "";
}

// Lets the browser show what was said before a step that takes long.
const shown = () => new Promise(resolve => setTimeout(resolve, 20));

const size = () => at("size").value.split("x").map(Number);

function settings() {
  const [width, height] = size();
  return JSON.stringify({
    method: at("method").value, visibility: at("visibility").value, width, height,
    bounces: Number(at("bounces").value), seed: Number(at("seed").value),
  });
}

function save(name, bytes, type) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([bytes], { type }));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

async function draw(session) {
  const stops = at("exposure").value;
  const pixels = await session.pixels(stops === "" ? undefined : Number(stops));
  [canvas.width, canvas.height] = [session.width, session.height];
  context.putImageData(new ImageData(new Uint8ClampedArray(pixels), canvas.width, canvas.height), 0, 0);
  at("exposure").placeholder = `automatic (${session.stops.toFixed(2)})`;
  const error = await session.error();
  at("error").textContent = error === undefined ? "" : `rel_mse against the reference: ${error.toExponential(2)}`;
  const times = JSON.parse(session.times());
  at("times").innerHTML = "";
  if (!times.length) at("times").insertRow().insertCell().textContent = "This browser has not timed any yet.";
  for (const [pass, milliseconds] of times) {
    const row = at("times").insertRow();
    row.insertCell().textContent = pass;
    row.insertCell().textContent = `${milliseconds.toFixed(2)} ms`;
  }
}

// One round: does what is wanted, or adds a batch. Returns false if there is nothing to do.
async function round(session, progress) {
  if (wanted.reference) {
    const { name, bytes } = wanted.reference;
    wanted.reference = null;
    session.compare_with(name, bytes);
    wanted.draw = true;
  }
  if (wanted.scene) {
    const { file } = wanted, name = file?.name ?? at("scene").value;
    Object.assign(wanted, { scene: false, file: null, camera: [], settings: true });
    say(`Loading ${name}.`);
    await shown();
    for (const { name, bytes } of file ? wanted.beside : []) session.add_file(name, bytes);
    if (file) session.load_file(name, file.bytes, ...size()); else session.load_builtin(name, ...size());
    at("notes").replaceChildren(...session.notes().map(note => Object.assign(document.createElement("li"), { textContent: note })));
  }
  if (wanted.settings) {
    wanted.settings = false;
    progress.ready = false;
    say("Compiling shaders.");
    await shown();
    await session.open(settings());
    at("plan").textContent = session.plan();
    Object.assign(progress, { ready: true, samples: 0, batch: 1, seconds: 0, posted: false });
  }
  if (!progress.ready) return false;
  if (wanted.camera.length) {
    for (const [how, x, y] of wanted.camera.splice(0)) session[how](x, y);
    await session.move_camera();
    Object.assign(progress, { samples: 0, seconds: 0 });
  }
  const left = Number(at("samples").value) - progress.samples;
  if (left > 0) {
    const began = performance.now(), batch = Math.min(progress.batch, left);
    progress.samples = await session.render(batch);
    const took = performance.now() - began;
    progress.batch = Math.max(1, Math.min(Math.floor(batch * BATCH / took), 2 * batch));
    progress.seconds += took / 1000;
    wanted.draw = true;
  }
  if (wanted.draw) {
    wanted.draw = false;
    await draw(session);
    say(`${progress.samples} samples, ${progress.seconds.toFixed(1)} s on ${session.adapter}.`);
  }
  if (left > 0) return true;
  if (address.has("post") && !progress.posted) {
    progress.posted = true;
    await fetch(address.get("post"), { method: "POST", body: await session.exr() });
  }
  return false;
}

function listen() {
  for (const id of controls) at(id).addEventListener("change", () => want(id === "scene" ? { scene: true } : id === "samples" ? {} : { settings: true }));
  at("exposure").addEventListener("input", () => want({ draw: true }));

  const open = async list => {
    const files = await Promise.all(Array.from(list, async file => ({ name: file.name, bytes: new Uint8Array(await file.arrayBuffer()) })));
    // A mesh beside a scene is a part of it.
    const ending = pattern => files.find(file => pattern.test(file.name));
    const scene = ending(/\.(gl(b|tf)|vrm|xml)$/i) ?? ending(/\.obj$/i) ?? ending(/\.(ply|stl)$/i);
    const reference = ending(/\.exr$/i);
    if (scene) want({ file: scene, beside: files.filter(file => file !== scene), scene: true });
    else if (reference) want({ reference });
    else if (files.length) say(`${files[0].name} is no scene (.glb, .gltf, .vrm, .xml, .obj, .ply, .stl) and no picture to compare with (.exr).`, true);
  };
  at("file").addEventListener("change", event => open(event.target.files));
  document.addEventListener("dragover", event => { event.preventDefault(); document.body.classList.add("over"); });
  document.addEventListener("dragleave", () => document.body.classList.remove("over"));
  document.addEventListener("drop", event => {
    event.preventDefault();
    document.body.classList.remove("over");
    open(event.dataTransfer.files);
  });

  let from = null;
  const move = (...step) => want({ camera: [...wanted.camera, step] });
  canvas.addEventListener("pointerdown", event => { from = [event.clientX, event.clientY]; canvas.setPointerCapture(event.pointerId); });
  canvas.addEventListener("pointerup", () => { from = null; });
  canvas.addEventListener("pointermove", event => {
    if (!from) return;
    const [x, y] = [event.clientX - from[0], event.clientY - from[1]].map(d => d / canvas.clientHeight);
    from = [event.clientX, event.clientY];
    move(event.shiftKey ? "shift" : "orbit", x, y);
  });
  canvas.addEventListener("wheel", event => { event.preventDefault(); move("approach", Math.exp(event.deltaY / 800), 0); }, { passive: false });

  for (const id of ["png", "exr", "keep"]) at(id).addEventListener("click", () => want({ action: id }));
}

async function act(session, action) {
  if (action === "png") canvas.toBlob(blob => save("lightsheaf.png", blob, "image/png"));
  if (action === "exr") save("lightsheaf.exr", await session.exr(), "image/x-exr");
  if (action === "keep") { await session.keep(); wanted.draw = true; }
}

// What was asked for cannot be done: the page says why and waits for other wishes.
async function fail(error) {
  const text = String(error?.message ?? error);
  say(text, true);
  if (address.has("post")) await fetch(address.get("post"), { method: "POST", headers: { "X-Error": "1" }, body: text });
}

async function run() {
  if (!navigator.gpu) {
    const why = window.isSecureContext ? "" : ", since it came neither by https nor from localhost";
    throw `There is no WebGPU for this page${why}. Recent versions of Chrome, Edge, Safari and Firefox have it; on Linux it may have to be switched on.`;
  }
  if (!await navigator.gpu.requestAdapter()) throw "This browser has WebGPU, but no device for it: its graphics driver may be blocked or missing.";
  listen();
  await start();
  at("scene").replaceChildren(...scene_names().map(name => new Option(name)));
  for (const id of controls) if (address.has(id)) at(id).value = address.get(id);
  const session = await Session.start();
  const progress = { ready: false, samples: 0, batch: 1, seconds: 0, posted: false };
  for (;;) {
    changed = false;
    let busy = false;
    try {
      const { action } = wanted;
      wanted.action = null;
      if (action && progress.ready) await act(session, action);
      busy = await round(session, progress);
    } catch (error) {
      progress.ready = false;
      await fail(error);
    }
    session.measure(at("timing").open);
    if (!busy) await change();
  }
}

run().catch(fail);
