// The WebSocket to the race: what comes in goes to handlers by kind, what goes out is dropped while there is no line.

const AGAIN = 1000; // after a lost connection, until the next try [ms]
const FULL = 1013; // close code: all seats are taken
const REFUSED = 1008;

export class Line {
  /** @param handlers by kind of message  @param say called with "open", "lost" or "over" and why */
  constructor(path, handlers, say) {
    const { protocol, host, search } = window.location;
    this.address = `${protocol === "https:" ? "wss" : "ws"}://${host}${path}${search}`;
    this.handlers = handlers;
    this.say = say;
    this.#open();
  }

  #open() {
    this.socket = new WebSocket(this.address);
    this.socket.addEventListener("open", () => this.say("open", ""));
    this.socket.addEventListener("message", ({ data }) => this.#take(JSON.parse(data)));
    this.socket.addEventListener("close", ({ code, reason }) => this.#closed(code, reason));
  }

  #take(message) {
    for (const [kind, content] of Object.entries(message)) this.handlers[kind]?.(content);
  }

  #closed(code, reason) {
    if (code === REFUSED) return this.say("over", reason);
    this.say("lost", code === FULL ? reason : "");
    setTimeout(() => this.#open(), AGAIN);
  }

  send(message) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(message));
  }
}
