// Races that arrive while the page is open, by server-sent events.

const KEPT = 30; // races
const WAITING = "Waiting for the first race";

export class Live {
  /** @param app  @param stream address of the events */
  constructor(app, stream, badge) {
    this.app = app;
    this.badge = badge;
    this.say("connecting", "Connecting");
    app.element("empty").textContent = WAITING;
    this.source = new EventSource(stream);
    this.source.addEventListener("open", () => this.say("live", "Live"));
    this.source.addEventListener("error", () => this.say("lost", "Connection lost"));
    this.source.addEventListener("race", (event) => this.#take(JSON.parse(event.data)));
    this.source.addEventListener("status", (event) => this.#status(JSON.parse(event.data)));
    this.source.addEventListener("end", (event) => this.#end(JSON.parse(event.data)));
  }

  #take(race) {
    const { app } = this;
    const last = app.races.at(-1);
    if (last && last.label === race.label && last.outcome === race.outcome) return; // told again after a lost connection
    const idle = app.race === null || (app.atEnd && app.index === app.races.length - 1);
    app.races.push(race);
    if (app.races.length > KEPT) app.races.splice(app.index === 0 ? 1 : 0, 1);
    if (idle) app.showRace(app.races.length - 1, { play: true });
    else app.listRaces();
    this.say("live", "Live");
  }

  #status({ text }) {
    this.app.element("status").textContent = text;
  }

  #end({ text }) {
    this.source.close();
    this.app.live = null;
    this.say("over", text);
  }

  say(state, text) {
    this.badge.hidden = false;
    this.badge.dataset.state = state;
    this.badge.textContent = text;
  }
}
