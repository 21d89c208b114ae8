"use strict";
// Tells scripts how it went: data-ready is the number of images, data-error what was thrown, data-selftest the result of
// a page opened with #selftest.
const root = document.documentElement;
addEventListener("error", (event) => { root.dataset.error = event.message; });
addEventListener("unhandledrejection", (event) => { root.dataset.error = String(event.reason); });
const $ = (id) => document.getElementById(id);

// One of several plots at a time; without this script all of them show.
function tabs(container) {
  const figures = [...container.querySelectorAll("figure")];
  if (figures.length < 2) return;
  const bar = document.createElement("div");
  bar.className = "tabs";
  bar.setAttribute("role", "group");
  bar.setAttribute("aria-label", "Measure of error");
  const show = (chosen) => figures.forEach((figure, index) => {
    figure.hidden = index !== chosen;
    bar.children[index].setAttribute("aria-pressed", index === chosen);
  });
  figures.forEach((figure, index) => {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = figure.dataset.title;
    button.addEventListener("click", () => show(index));
    bar.append(button);
  });
  container.prepend(bar);
  show(0);
}

// 16-bit floating point to 32-bit, for all 65536 patterns.
function halfTable() {
  const table = new Float32Array(65536);
  for (let bits = 0; bits < 65536; bits++) {
    const exponent = (bits >> 10) & 31, fraction = bits & 1023, sign = bits & 32768 ? -1 : 1;
    table[bits] = sign * (exponent === 31 ? (fraction ? NaN : Infinity)
      : exponent ? (1 + fraction / 1024) * 2 ** (exponent - 15) : fraction * 2 ** -24);
  }
  return table;
}

function decode(base64) {
  const text = atob(base64.trim()), halves = new Uint16Array(text.length / 2);
  for (let i = 0; i < halves.length; i++) halves[i] = text.charCodeAt(2 * i) | (text.charCodeAt(2 * i + 1) << 8);
  return halves;
}

function viewer(config) {
  const { width, height, low, high, heat } = config;
  const images = config.names.map((name, index) => ({ name, halves: decode($("pixels-" + index).textContent), drawn: {} }));
  const reference = images[0].halves, floats = halfTable();
  // The image left of the slider, the one right of it, and the part of the canvas that the slider leaves to the left.
  const state = { a: Math.min(1, images.length - 1), b: 0, map: false, split: false, at: 0.5, stops: 0, zoom: 1, x: 0, y: 0, fitted: true };
  const canvas = $("canvas"), context = canvas.getContext("2d"), stage = $("stage"), handle = $("handle");

  // The sRGB transfer function after the exposure, for every pattern of 16 bits; magenta marks NaN, as in PNG files.
  let tones = null, tonesFor = null;
  function toneTable() {
    if (tonesFor === state.stops) return tones;
    tones = new Uint8ClampedArray(65536);
    const gain = 2 ** state.stops;
    for (let bits = 0; bits < 65536; bits++) {
      const linear = Math.min(Math.max(floats[bits] * gain, 0), 1);
      tones[bits] = Math.round(255 * (linear <= 0.0031308 ? 12.92 * linear : 1.055 * linear ** (1 / 2.4) - 0.055));
    }
    tonesFor = state.stops;
    return tones;
  }
  const colour = (halves, pixel) => [0, 1, 2].map((channel) => floats[halves[3 * pixel + channel]]);
  const valid = (values) => values.every((value) => Number.isFinite(value) && value >= 0);
  function relativeError(halves, pixel) {
    const image = colour(halves, pixel), truth = colour(reference, pixel);
    if (!valid(image) || !valid(truth)) return NaN;
    return [0, 1, 2].reduce((sum, c) => sum + (image[c] - truth[c]) ** 2 / (truth[c] ** 2 + config.epsilon), 0) / 3;
  }
  function picture(image) {
    const key = state.map ? "map" : state.stops;
    const kept = image.drawn[state.map ? "map" : "image"];
    if (kept && kept.key === key) return kept.canvas;
    const layer = kept ? kept.canvas : document.createElement("canvas");
    [layer.width, layer.height] = [width, height];
    const data = new ImageData(width, height), bytes = data.data, tone = toneTable();
    for (let pixel = 0; pixel < width * height; pixel++) {
      let rgb = [255, 0, 255];
      if (state.map) {
        const error = relativeError(image.halves, pixel);
        const place = (Math.log10(Math.max(error, 1e-30)) - low) / (high - low);
        const entry = 3 * Math.round(255 * Math.min(Math.max(place, 0), 1));
        if (!Number.isNaN(error)) rgb = [heat[entry], heat[entry + 1], heat[entry + 2]];
      } else if (!colour(image.halves, pixel).some(Number.isNaN)) {
        rgb = [0, 1, 2].map((channel) => tone[image.halves[3 * pixel + channel]]);
      }
      bytes.set(rgb, 4 * pixel);
      bytes[4 * pixel + 3] = 255;
    }
    layer.getContext("2d").putImageData(data, 0, 0);
    image.drawn[state.map ? "map" : "image"] = { key, canvas: layer };
    return layer;
  }

  // Zoom counts pixels of the canvas for each pixel of the image; x and y are the image's corner on the canvas.
  function fit() {
    state.zoom = Math.min(canvas.width / width, canvas.height / height);
    state.x = (canvas.width - width * state.zoom) / 2;
    state.y = (canvas.height - height * state.zoom) / 2;
    state.fitted = true;
    draw();
  }
  function zoomBy(factor, x = canvas.width / 2, y = canvas.height / 2) {
    const zoom = Math.min(Math.max(state.zoom * factor, 0.05), 100), by = zoom / state.zoom;
    state.x = x - (x - state.x) * by;
    state.y = y - (y - state.y) * by;
    state.zoom = zoom;
    state.fitted = false;
    draw();
  }
  function draw() {
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.clearRect(0, 0, canvas.width, canvas.height);
    // Enlarged pixels stay squares.
    context.imageSmoothingEnabled = state.zoom < 1;
    context.imageSmoothingQuality = "high";
    const paint = (image) => context.drawImage(picture(image), state.x, state.y, width * state.zoom, height * state.zoom);
    paint(images[state.a]);
    if (state.split) {
      const left = Math.round(state.at * canvas.width);
      context.save();
      context.beginPath();
      context.rect(left, 0, canvas.width - left, canvas.height);
      context.clip();
      context.clearRect(left, 0, canvas.width - left, canvas.height);
      paint(images[state.b]);
      context.restore();
    }
    update();
  }
  function update() {
    [...$("choices").children].forEach((button, index) => button.setAttribute("aria-pressed", index === state.a));
    $("map").checked = state.map;
    $("split").checked = state.split;
    $("other").value = state.b;
    $("stops").value = state.stops;
    $("stops-value").textContent = (state.stops > 0 ? "+" : "") + state.stops;
    $("zoom-value").textContent = +(state.zoom / devicePixelRatio).toPrecision(2) + "×";
    $("tag-left").textContent = images[state.a].name;
    $("tag-right").textContent = state.split ? images[state.b].name : "";
    $("viewer-scale").hidden = !state.map;
    handle.hidden = !state.split;
    handle.style.left = 100 * state.at + "%";
    handle.setAttribute("aria-valuenow", Math.round(100 * state.at));
    canvas.setAttribute("aria-label", (state.map ? "Error map of " : "") + images[state.a].name
      + (state.split ? ", right of the slider " + images[state.b].name : ""));
  }
  function change(changes) {
    Object.assign(state, changes);
    state.at = Math.min(Math.max(state.at, 0), 1);
    state.stops = Math.min(Math.max(state.stops, -8), 8);
    draw();
  }
  function resize() {
    const room = stage.clientWidth, tall = Math.max(240, Math.min(room * height / width, 0.8 * innerHeight));
    canvas.style.height = tall + "px";
    canvas.width = Math.max(1, Math.round(room * devicePixelRatio));
    canvas.height = Math.max(1, Math.round(tall * devicePixelRatio));
    if (state.fitted) fit(); else draw();
  }
  const onCanvas = (event) => {
    const box = canvas.getBoundingClientRect();
    return [(event.clientX - box.left) * canvas.width / box.width, (event.clientY - box.top) * canvas.height / box.height];
  };
  const digits = (value) => Number.isFinite(value) ? (value === 0 ? "0" : Math.abs(value) < 1e-3 || Math.abs(value) >= 1e5
    ? value.toExponential(2) : value.toPrecision(4)) : String(value);
  function readout(event) {
    const [x, y] = onCanvas(event);
    const column = Math.floor((x - state.x) / state.zoom), row = Math.floor((y - state.y) / state.zoom);
    if (column < 0 || row < 0 || column >= width || row >= height) return void ($("readout").textContent = "");
    const pixel = row * width + column;
    const right = state.split && x >= state.at * canvas.width;
    const shown = images[right ? state.b : state.a];
    const line = (image) => colour(image.halves, pixel).map(digits).join("  ");
    $("readout").textContent = `x ${column}, y ${row}   ${shown.name}: ${line(shown)}   error ${digits(relativeError(shown.halves, pixel))}\n`
      + `${images[0].name}: ${line(images[0])}`;
  }

  images.forEach((image, index) => {
    const button = document.createElement("button");
    button.type = "button";
    button.append(image.name);
    if (index < 9) {
      const key = document.createElement("kbd");
      key.textContent = index + 1;
      button.append(" ", key);
    }
    button.addEventListener("click", () => change({ a: index }));
    $("choices").append(button);
    $("other").append(new Option(image.name, index));
  });
  $("map").addEventListener("change", (event) => change({ map: event.target.checked }));
  $("split").addEventListener("change", (event) => change({ split: event.target.checked }));
  $("other").addEventListener("change", (event) => change({ b: +event.target.value, split: true }));
  $("stops").addEventListener("input", (event) => change({ stops: +event.target.value }));
  $("zoom-in").addEventListener("click", () => zoomBy(2));
  $("zoom-out").addEventListener("click", () => zoomBy(0.5));
  $("fit").addEventListener("click", fit);
  canvas.addEventListener("dblclick", fit);
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 20 : 1;
    zoomBy(2 ** (-event.deltaY * lines / 300), ...onCanvas(event));
    readout(event);
  }, { passive: false });
  canvas.addEventListener("pointermove", readout);
  canvas.addEventListener("pointerleave", () => { $("readout").textContent = ""; });

  // Dragging goes on outside of what it began on, until the button is released.
  function drag(element, moved) {
    let last = null;
    element.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      last = onCanvas(event);
      // Fails for pointers that a script made up.
      try { element.setPointerCapture(event.pointerId); } catch { /* dragging works without, as long as it stays inside */ }
    });
    element.addEventListener("pointermove", (event) => {
      if (!last) return;
      const place = onCanvas(event);
      moved(place, [place[0] - last[0], place[1] - last[1]]);
      last = place;
    });
    for (const end of ["pointerup", "pointercancel"]) element.addEventListener(end, () => { last = null; });
  }
  drag(canvas, (_, [dx, dy]) => change({ x: state.x + dx, y: state.y + dy, fitted: false }));
  drag(handle, ([x]) => change({ at: x / canvas.width }));
  handle.addEventListener("keydown", (event) => {
    const steps = { ArrowLeft: -0.01, ArrowRight: 0.01, PageDown: -0.1, PageUp: 0.1, Home: -1, End: 1 };
    if (!(event.key in steps)) return;
    event.preventDefault();
    change({ at: state.at + steps[event.key] });
  });
  addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || /^(SELECT|TEXTAREA)$/.test(event.target.tagName)) return;
    const digit = /^(?:Digit|Numpad)([1-9])$/.exec(event.code);
    if (digit) {
      const index = digit[1] - 1;
      if (index < images.length) change(event.shiftKey ? { b: index, split: true } : { a: index });
    } else if (event.key === "e" || event.key === "E") change({ map: !state.map });
    else if (event.key === "s" || event.key === "S") change({ split: !state.split });
    else if (event.key === "f" || event.key === "F") fit();
    else if (event.key === "+" || event.key === "=") change({ stops: state.stops + 0.5 });
    else if (event.key === "-") change({ stops: state.stops - 0.5 });
  });
  $("viewer").hidden = false;
  addEventListener("resize", resize);
  resize();
  return { state, canvas, handle, images };
}

// Goes through what a reader can do, by the same events, and says what came of it.
function selftest(viewer) {
  let checks = 0;
  const check = (holds, what) => {
    if (!holds) throw new Error(what);
    checks++;
  };
  const { state, canvas, handle, images } = viewer;
  // A copy that may be read often, so that reading does not change how the viewer draws.
  const copy = document.createElement("canvas");
  [copy.width, copy.height] = [canvas.width, canvas.height];
  const context = copy.getContext("2d", { willReadFrequently: true });
  const bytes = (left = 0, right = canvas.width) => {
    context.clearRect(0, 0, copy.width, copy.height);
    context.drawImage(canvas, 0, 0);
    return context.getImageData(left, 0, right - left, copy.height).data;
  };
  const hash = (...part) => bytes(...part).reduce((sum, byte) => Math.imul(sum ^ byte, 16777619), 2166136261);
  const press = (code, name, more) => document.body.dispatchEvent(new KeyboardEvent("keydown", { code, key: name, bubbles: true, ...more }));
  const pointer = (element, type, x, y) => {
    const box = canvas.getBoundingClientRect();
    element.dispatchEvent(new PointerEvent(type, { bubbles: true, pointerId: 1, button: 0,
      clientX: box.left + x * box.width, clientY: box.top + y * box.height }));
  };
  const picture = bytes();
  check(new Set(picture).size > 8, "the canvas shows something");

  const seen = new Set();
  images.slice(0, 9).forEach((image, index) => {
    press("Digit" + (index + 1), String(index + 1));
    check(state.a === index && $("tag-left").textContent === image.name, "key " + (index + 1) + " shows " + image.name);
    check($("choices").children[index].getAttribute("aria-pressed") === "true", "the button of " + image.name + " is pressed");
    seen.add(hash());
  });
  check(seen.size === Math.min(images.length, 9), "flipping shows " + images.length + " different images, not " + seen.size);
  $("choices").children[0].click();
  check(state.a === 0, "a button shows its image");

  const plain = hash();
  press("KeyE", "e");
  check(hash() !== plain && !$("viewer-scale").hidden, "the error map shows, with its scale");
  press("KeyE", "e");
  check(hash() === plain, "the error map goes");
  press("Equal", "+");
  check(hash() !== plain && $("stops-value").textContent === "+0.5", "the exposure changes");
  press("Minus", "-");
  check(hash() === plain, "and changes back");

  const middle = canvas.width >> 1, last = images.length - 1;
  press("Digit" + (last + 1), "!", { shiftKey: true });
  check(state.split && state.b === last && !handle.hidden, "shift and a digit open the slider");
  const left = hash(0, middle - 2), right = hash(middle + 2);
  press("KeyS", "s");
  check(hash(0, middle - 2) === left, "left of the slider is the first image");
  if (last > 0) check(hash(middle + 2) !== right, "right of the slider is the second image");
  press("KeyS", "s");
  pointer(handle, "pointerdown", 0.5, 0.5);
  pointer(handle, "pointermove", 0.25, 0.5);
  pointer(handle, "pointerup", 0.25, 0.5);
  check(Math.abs(state.at - 0.25) < 0.01, "the slider can be dragged");
  pointer(handle, "pointermove", 0.9, 0.5);
  check(Math.abs(state.at - 0.25) < 0.01, "and stays when released");
  handle.dispatchEvent(new KeyboardEvent("keydown", { key: "PageUp", bubbles: true }));
  check(Math.abs(state.at - 0.35) < 0.01 && handle.getAttribute("aria-valuenow") === "35", "the slider takes keys");
  press("KeyS", "s");

  pointer(canvas, "pointermove", 0.5, 0.5);
  check(/^x \d+, y \d+ /.test($("readout").textContent), "the pixel under the pointer is read out");
  const zoom = state.zoom, box = canvas.getBoundingClientRect();
  canvas.dispatchEvent(new WheelEvent("wheel", { deltaY: -300, clientX: box.left + 1, clientY: box.top + 1, cancelable: true }));
  check(Math.abs(state.zoom / zoom - 2) < 1e-6 && hash() !== plain, "the wheel zooms");
  const x = state.x;
  pointer(canvas, "pointerdown", 0.5, 0.5);
  pointer(canvas, "pointermove", 0.6, 0.5);
  pointer(canvas, "pointerup", 0.6, 0.5);
  check(Math.abs(state.x - x - 0.1 * canvas.width) < 1, "dragging moves the image");
  press("KeyF", "f");
  check(hash() === plain, "fit shows the whole image again");

  const plots = [...$("error-plots").querySelectorAll(".tabs button")];
  plots.forEach((button, index) => {
    button.click();
    const figures = [...$("error-plots").querySelectorAll("figure")];
    check(figures.every((figure, other) => figure.hidden === (other !== index)), "a tab shows its plot");
  });
  plots[0]?.click();
  return "ok: " + checks + " checks";
}

tabs($("error-plots"));
const config = $("config");
let shown = null;
if (config) shown = viewer(JSON.parse(config.textContent));
if (location.hash === "#selftest" && shown) {
  try {
    root.dataset.selftest = selftest(shown);
  } catch (error) {
    root.dataset.selftest = "failed: " + error.message;
  }
}
root.dataset.ready = shown ? shown.images.length : 0;
