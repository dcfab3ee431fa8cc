// `window.replay`: the page for scripts and tests, described in docs/replay.md.

import { project } from "./view/labels.js";

export function makeApi(app) {
  return {
    get duration() {
      return app.race?.duration ?? 0;
    },
    get races() {
      return app.races.length;
    },
    /** Pictures drawn so far. */
    get frames() {
      return app.frames;
    },
    state: () => state(app),
    play: () => app.play(),
    pause: () => app.play(false),
    showRace: (index) => app.showRace(index).then(() => seen(app)),
    /** Stop at a time and change the view with {camera, follow, trail, theme, speed}; gives the state. */
    seek(t, { camera, follow, trail, theme, speed } = {}) {
      if (follow !== undefined) app.follow(follow);
      if (trail !== undefined) app.setTrail(trail);
      if (theme !== undefined) app.theme.choose(theme);
      if (speed !== undefined) app.setSpeed(speed);
      if (camera !== undefined) app.setCamera(camera);
      app.seek(t);
      return seen(app);
    },
  };
}

function seen(app) {
  app.draw();
  return state(app);
}

/** Everything that can be seen, as plain numbers. */
function state(app) {
  const { race, time, stage, cameras } = app;
  if (!race) return { race: null, live: Boolean(app.live) };
  const { camera, width, height } = stage;
  return {
    race: app.index,
    time,
    playing: app.playing,
    speed: app.speed,
    theme: app.theme.name,
    followed: app.subject.index,
    trail: { ...app.trail },
    camera: {
      mode: cameras.mode,
      position: camera.position.toArray(),
      quaternion: camera.quaternion.toArray(),
      fov: camera.fov,
      width,
      height,
      shift: [...cameras.shift],
    },
    standings: app.standings.map(({ drone, rank, passed, lap, gap, split, speed, status }) => ({
      drone: drone.index,
      rank,
      passed,
      lap,
      gap,
      split,
      speed,
      status,
    })),
    drones: race.drones.map((drone, k) => {
      const { position, velocity, attitude } = drone.flight.at(time);
      const at = project(app.models[k].group.position, stage);
      return { position, velocity, attitude, ghost: drone.ghost, screen: at && [at.x, at.y] };
    }),
  };
}
