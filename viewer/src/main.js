// Starts the page with the data written into it.

import { makeApi } from "./api.js";
import { App } from "./app.js";
import { Fly } from "./fly/fly.js";
import { Live } from "./live.js";

const FORMAT = 1; // of the data, see docs/replay.md

async function begin() {
  const data = JSON.parse(document.getElementById("data").textContent);
  if (data.format !== FORMAT) throw new Error(`this page reads format ${FORMAT}, the data has ${data.format}`);
  if (data.fly) return fly(data.fly);
  const app = new App(document.body);
  window.replay = makeApi(app);
  app.races = data.races;
  app.live = data.live;
  const wish = new URLSearchParams(location.hash.slice(1));
  if (wish.has("camera")) app.setCamera(wish.get("camera"));
  if (wish.has("theme")) app.theme.choose(wish.get("theme"));
  const still = wish.has("t") || window.matchMedia("(prefers-reduced-motion: reduce)").matches;
  const time = Number(wish.get("t")) || 0;
  await app.showRace((Number(wish.get("race")) || 1) - 1, { play: !still, time });
  if (wish.has("drone")) app.follow(Number(wish.get("drone")) - 1);
  if (data.live) new Live(app, data.live.stream, app.element("badge"));
  app.draw();
  document.documentElement.dataset.ready = "true";
}

/** The page of a person who flies. `window.fly` is for scripts and tests. */
function fly({ line }) {
  document.body.replaceChildren(document.getElementById("flying").content);
  document.documentElement.dataset.loaded = "true";
  window.fly = new Fly(document.body, line);
  document.documentElement.dataset.ready = "true";
}

begin().catch((error) => {
  const place = document.getElementById("empty") ?? document.body;
  place.hidden = false;
  place.textContent = `The replay cannot be shown: ${error.message}`;
  document.documentElement.dataset.ready = "failed";
  throw error;
});
