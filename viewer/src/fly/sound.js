// Motors, gates and the countdown, made on the spot.

const IDLE = 70; // of the motors [Hz]
const SPAN = 260; // from idle to full throttle [Hz]
const NEAR = 3; // a rival at this distance is half as loud [m]

export class Sound {
  constructor() {
    this.muted = false;
    this.volume = 0.5;
    for (const kind of ["pointerdown", "keydown"])
      window.addEventListener(kind, () => this.#wake(), { capture: true, passive: true });
  }

  /** A browser lets nobody sound before the first touch. */
  #wake() {
    if (!this.context) this.#build();
    if (this.context.state === "suspended") this.context.resume();
  }

  #build() {
    this.context = new AudioContext({ latencyHint: "interactive" });
    this.master = this.context.createGain();
    this.master.gain.value = 0;
    this.master.connect(this.context.destination);
    this.own = this.#motor(0);
    this.rival = this.#motor(17);
    this.turn(this.muted);
  }

  #motor(detune) {
    const filter = this.context.createBiquadFilter();
    filter.type = "lowpass";
    const gain = this.context.createGain();
    gain.gain.value = 0;
    const oscillators = [1, 1.013, 2.02].map((factor) => {
      const oscillator = this.context.createOscillator();
      oscillator.type = "sawtooth";
      oscillator.detune.value = detune;
      oscillator.connect(filter);
      oscillator.start();
      return { oscillator, factor };
    });
    filter.connect(gain).connect(this.master);
    return { filter, gain, oscillators };
  }

  turn(muted) {
    this.muted = muted;
    this.master?.gain.setTargetAtTime(muted ? 0 : this.volume, this.context.currentTime, 0.03);
  }

  loudness(volume) {
    this.volume = volume;
    this.turn(this.muted);
  }

  /** @param effort of the own motors in [0, 1], null where they stand  @param distance of the nearest rival [m] */
  fly(effort, distance) {
    if (!this.context) return;
    this.#run(this.own, effort ?? 0, effort === null ? 0 : 0.12);
    this.#run(this.rival, 0.7, Number.isFinite(distance) ? 0.1 / (1 + (distance / NEAR) ** 2) : 0);
  }

  #run({ filter, gain, oscillators }, effort, loud) {
    const now = this.context.currentTime;
    const pitch = IDLE + SPAN * effort;
    for (const { oscillator, factor } of oscillators) oscillator.frequency.setTargetAtTime(pitch * factor, now, 0.03);
    filter.frequency.setTargetAtTime(4 * pitch + 300, now, 0.03);
    gain.gain.setTargetAtTime(loud, now, 0.05);
  }

  gate() {
    this.#beep(880, 0.09);
    this.#beep(1320, 0.12, 0.07);
  }

  count(last) {
    this.#beep(last ? 880 : 440, last ? 0.4 : 0.15);
  }

  crash() {
    this.#beep(90, 0.5, 0, "square");
  }

  #beep(pitch, length, after = 0, type = "sine") {
    if (!this.context) return;
    const from = this.context.currentTime + after;
    const oscillator = this.context.createOscillator();
    const gain = this.context.createGain();
    oscillator.type = type;
    oscillator.frequency.value = pitch;
    gain.gain.setValueAtTime(0.25, from);
    gain.gain.exponentialRampToValueAtTime(1e-3, from + length);
    oscillator.connect(gain).connect(this.master);
    oscillator.start(from);
    oscillator.stop(from + length);
  }
}
