"use strict";
// One tab: a terminal, a WebSocket to the process behind it, and a bar of keys where fingers are used.
// What is said over the socket is described in tui/web/session.py.

const NO_TOKEN = "This tab has no token: open the address that `robotree web` printed, with all that is behind its #.";
const LARGEST = 8192; // letters in a message; who pastes more sends several
const by = (id) => document.getElementById(id);
let socket = null, terminal = null, fit = null, control = false, ended = "";

function token() {
  if (location.hash.length > 1) {
    sessionStorage.setItem("token", decodeURIComponent(location.hash.slice(1)));
    history.replaceState(null, "", location.pathname); // it stays in no address bar and no picture of one
  }
  return sessionStorage.getItem("token") || "";
}

function tell(sentence, again) {
  by("sentence").textContent = sentence;
  by("again").hidden = !again;
  by("told").hidden = false;
}

function say(thing) {
  if (socket && socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(thing));
}

function type(text) {
  if (control && text.length === 1) {
    text = String.fromCharCode(text.toUpperCase().charCodeAt(0) & 31);
    hold(false);
  }
  for (let at = 0; at < text.length; at += LARGEST) say({ keys: text.slice(at, at + LARGEST) });
}

function hold(pressed) {
  control = pressed;
  by("control").setAttribute("aria-pressed", String(pressed));
}

function size() {
  return [Math.max(terminal.cols, 2), Math.max(terminal.rows, 2)];
}

function begin() {
  by("told").hidden = true;
  ended = "";
  const own = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/screen`);
  own.binaryType = "arraybuffer";
  socket = own;
  own.onopen = () => {
    terminal.reset();
    fit.fit();
    say({ token: token(), size: size(), page: location.pathname.slice(1) });
    if (document.hidden) say({ hidden: true });
  };
  own.onmessage = (event) => {
    if (typeof event.data !== "string") {
      const bytes = event.data.byteLength;
      terminal.write(new Uint8Array(event.data), () => say({ taken: bytes }));
      return;
    }
    const told = JSON.parse(event.data);
    if ("beat" in told) say({ beat: told.beat }); // no timer: those of hidden tabs are slow
    if ("ended" in told) ended = told.ended;
  };
  own.onclose = (event) => {
    if (socket !== own) return;
    socket = null;
    tell(ended || event.reason || "The connection has ended, and with it what this tab had begun.", true);
  };
}

function wheel(pane) { // a finger that moves up or down turns the wheel
  let last = null;
  pane.addEventListener("touchstart", (event) => { last = event.touches[0].clientY; }, { passive: true });
  pane.addEventListener("touchmove", (event) => {
    const touch = event.touches[0], step = terminal.options.fontSize * 1.5, moved = touch.clientY - last;
    if (Math.abs(moved) < step) return;
    last = touch.clientY;
    const box = pane.getBoundingClientRect();
    const column = Math.ceil(((touch.clientX - box.left) / box.width) * terminal.cols);
    const row = Math.ceil(((touch.clientY - box.top) / box.height) * terminal.rows);
    type(`\x1b[<${moved > 0 ? 64 : 65};${Math.max(column, 1)};${Math.max(row, 1)}M`);
  }, { passive: true });
}

function letters(change) {
  terminal.options.fontSize = Math.min(Math.max(terminal.options.fontSize + change, 6), 32);
  fit.fit();
}

function operate(touched) {
  by("keys").classList.toggle("shown", touched);
  const field = terminal.textarea;
  if (touched) field.inputMode = "none"; // a tap is a click; the keyboard comes when it is asked for
  for (const button of document.querySelectorAll("#keys button")) {
    button.addEventListener("pointerdown", (event) => event.preventDefault()); // the focus stays
    if (button.dataset.keys) button.addEventListener("click", () => type(button.dataset.keys));
  }
  by("control").addEventListener("click", () => hold(!control));
  by("smaller").addEventListener("click", () => letters(-1));
  by("larger").addEventListener("click", () => letters(1));
  by("keyboard").addEventListener("click", () => {
    const wanted = field.inputMode === "none";
    field.inputMode = wanted ? "text" : "none";
    by("keyboard").setAttribute("aria-pressed", String(wanted));
    field.blur();
    field.focus();
  });
}

window.addEventListener("DOMContentLoaded", () => {
  if (!token()) {
    tell(NO_TOKEN, false);
    return;
  }
  const touched = matchMedia("(pointer: coarse)").matches || innerWidth < 600;
  terminal = new xterm.Terminal({
    allowProposedApi: true, scrollback: 0, fontSize: touched ? 12 : 15, cursorBlink: false,
    fontFamily: 'ui-monospace, Menlo, Consolas, "DejaVu Sans Mono", "Droid Sans Mono", monospace',
    theme: { background: "#14171d" },
  });
  fit = new xterm.FitAddon();
  terminal.loadAddon(fit);
  terminal.loadAddon(new xterm.Unicode11Addon());
  terminal.unicode.activeVersion = "11";
  terminal.open(by("screen"));
  operate(touched);
  fit.fit();
  terminal.onData(type);
  terminal.onResize(() => say({ size: size() }));
  new ResizeObserver(() => fit.fit()).observe(by("screen"));
  wheel(by("screen"));
  by("again").addEventListener("click", begin);
  document.addEventListener("visibilitychange", () => say({ hidden: document.hidden }));
  window.addEventListener("pagehide", () => { if (socket) socket.close(); });
  begin();
  terminal.focus();
});
