// A phone as a camera: takes a picture when the studio asks for one.
"use strict";

const ALIVE_MS = 200; // The studio takes a phone that is silent for 0.8 s for gone.
const AGAIN_MS = 500; // Pause before the studio is called again.
const SETTLE_MS = 1500; // Time in which automatic exposure and focus settle before they are locked.
const PART_BYTES = 65536; // A part of a picture counts as a sign of life, so parts are small.
const EXPOSURE_UNIT_MS = 0.1; // exposureTime is in units of 100 µs (W3C, MediaStream Image Capture).
const FRESH_FRAMES = 2; // Frames that are skipped: the first after an order may be older than it.
const LOCKED = { exposureMode: "exposure", focusMode: "focus", whiteBalanceMode: "white balance" };

const said = document.getElementById("said");
const video = document.getElementById("seen");
let track = null;
let still = null;
let socket = null;

function say(text) {
  said.textContent = text;
}

const can = () => (track.getCapabilities ? track.getCapabilities() : {});

function exposures() {
  const range = can().exposureTime;
  if (!range || !(range.max > range.min)) return null;
  return [range.min * EXPOSURE_UNIT_MS, range.max * EXPOSURE_UNIT_MS];
}

async function lock() {
  const list = document.getElementById("locks");
  list.replaceChildren();
  for (const [mode, word] of Object.entries(LOCKED)) {
    let done = false;
    if ((can()[mode] || []).includes("manual")) {
      try {
        await track.applyConstraints({ advanced: [{ [mode]: "manual" }] });
        done = track.getSettings()[mode] === "manual";
      } catch {
        done = false;
      }
    }
    const item = document.createElement("li");
    item.textContent = done
      ? `The ${word} is locked.`
      : `This browser cannot lock the ${word}: do not move the phone, and keep the light steady.`;
    list.append(item);
  }
}

async function expose(milliseconds) {
  if (milliseconds !== null && milliseconds !== undefined) {
    const time = milliseconds / EXPOSURE_UNIT_MS;
    await track.applyConstraints({ advanced: [{ exposureMode: "manual", exposureTime: time }] });
  }
  const time = track.getSettings().exposureTime;
  return time === undefined ? null : time * EXPOSURE_UNIT_MS;
}

function freshFrame() {
  return new Promise((resolve) => {
    let left = FRESH_FRAMES;
    const next = () => {
      left -= 1;
      if (left < 0) resolve();
      else video.requestVideoFrameCallback(next);
    };
    if (video.requestVideoFrameCallback) next();
    else setTimeout(resolve, SETTLE_MS / 5);
  });
}

async function picture() {
  if (still) {
    try {
      return await still.takePhoto();
    } catch {
      still = null; // Some browsers offer stills and then refuse: frames of the video serve.
    }
  }
  await freshFrame();
  const canvas = document.createElement("canvas");
  canvas.width = video.videoWidth;
  canvas.height = video.videoHeight;
  canvas.getContext("2d").drawImage(video, 0, 0);
  return new Promise((resolve) => canvas.toBlob(resolve, "image/png"));
}

async function send(id, blob) {
  const content = new Uint8Array(await blob.arrayBuffer());
  const parts = Math.max(1, Math.ceil(content.length / PART_BYTES));
  for (let part = 0; part < parts; part += 1) {
    const body = content.subarray(part * PART_BYTES, (part + 1) * PART_BYTES);
    const whole = new Uint8Array(12 + body.length);
    const head = new DataView(whole.buffer);
    [id, part, parts].forEach((value, k) => head.setUint32(4 * k, value));
    whole.set(body, 12);
    socket.send(whole);
  }
}

async function obey(order) {
  try {
    if (document.visibilityState !== "visible") {
      throw new Error("its page is in the background or its screen is locked; show it and resume");
    }
    if (order.what === "take") await send(order.id, await picture());
    else if (order.what === "settings") {
      const used = await expose(order.exposure_ms);
      socket.send(JSON.stringify({ id: order.id, exposure_ms: used }));
    }
  } catch (error) {
    socket.send(JSON.stringify({ id: order.id, problem: `the phone refused: ${error.message}` }));
  }
}

function join() {
  const scheme = location.protocol === "https:" ? "wss" : "ws";
  socket = new WebSocket(`${scheme}://${location.host}/phone/socket`);
  socket.binaryType = "arraybuffer";
  socket.addEventListener("open", () => {
    const hello = { name: track.label, exposures_ms: exposures() };
    socket.send(JSON.stringify({ hello }));
    say("The phone is the camera. Keep this page open and the screen on.");
  });
  socket.addEventListener("message", (event) => obey(JSON.parse(event.data)));
  socket.addEventListener("close", (event) => {
    if (event.code === 4000) {
      say(event.reason);
      return;
    }
    say("The studio does not answer. Trying again…");
    setTimeout(join, AGAIN_MS);
  });
}

// A page that is not seen takes no pictures: its silence tells the studio.
setInterval(() => {
  const runs = track && track.readyState === "live" && document.visibilityState === "visible";
  if (runs && socket && socket.readyState === WebSocket.OPEN) socket.send("{}");
}, ALIVE_MS);

async function stayAwake() {
  try {
    await navigator.wakeLock?.request("screen");
  } catch {
    // Without it, the phone's own setting keeps the screen on.
  }
}

async function begin() {
  if (!navigator.mediaDevices) {
    say("The browser gives its camera to secure pages only: open this page over https.");
    return;
  }
  const wanted = { facingMode: "environment", width: { ideal: 4096 }, height: { ideal: 3072 } };
  try {
    const stream = await navigator.mediaDevices.getUserMedia({ video: wanted, audio: false });
    video.hidden = false;
    video.srcObject = stream;
    track = stream.getVideoTracks()[0];
  } catch (error) {
    say(`The browser gives no camera: ${error.message}`);
    return;
  }
  document.getElementById("begin").hidden = true;
  still = typeof ImageCapture === "function" ? new ImageCapture(track) : null;
  track.addEventListener("ended", () => location.reload());
  document.addEventListener("visibilitychange", () => {
    if (document.visibilityState === "visible") stayAwake();
  });
  await stayAwake();
  say("Exposure and focus settle…");
  await new Promise((resolve) => setTimeout(resolve, SETTLE_MS));
  await lock();
  join();
}

document.getElementById("begin").addEventListener("click", begin);
