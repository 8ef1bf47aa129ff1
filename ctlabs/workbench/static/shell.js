// What all pages do in the browser; the server calls the functions of ctlabs by name.

// The letter that is written on the key if it is a Latin one, else the one at its place on a keyboard with Latin letters.
const combinationOf = (e) => {
  let key = e.key.toLowerCase();
  if (!/^[a-z]$/.test(key) && /^Key[A-Z]$/.test(e.code)) key = e.code.slice(3).toLowerCase();
  if (!/^[0-9]$/.test(key) && /^Digit[0-9]$/.test(e.code) && (e.altKey || e.ctrlKey || e.metaKey)) key = e.code.slice(5);
  if (key === " ") key = "space";
  const shift = e.shiftKey && (/^[a-z0-9]$/.test(key) || key.length > 1);
  return (e.ctrlKey || e.metaKey ? "mod+" : "") + (e.altKey ? "alt+" : "") + (shift ? "shift+" : "") + key;
};
document.addEventListener("keydown", (e) => {
  if (!e.key || e.isComposing || e.getModifierState?.("AltGraph")) return;
  const keys = document.querySelector(".ctl-main")?.dataset.keys;
  if (!keys || !window.did_handshake) return;
  const combination = combinationOf(e), known = JSON.parse(keys)[combination];
  if (known === undefined) return;
  const t = e.target, field = t.isContentEditable || /^(INPUT|TEXTAREA|SELECT)$/.test(t.tagName);
  if (field && !known) return;
  e.preventDefault();
  e.stopPropagation();
  if (combination === "f1" && ctlabs.help(t)) return;
  emitEvent("ctlabs_key", combination);
}, true);
window.addEventListener("popstate", () => emitEvent("ctlabs_went", location.pathname));
// plotly resizes a plot a moment after it has been drawn, also when its page has been left by then.
window.addEventListener("unhandledrejection", (e) => {
  if (/displayed plot div element/.test(e.reason?.message ?? e.reason)) e.preventDefault();
});
// What is typed while there is no connection would be lost when the page is loaded again.
document.addEventListener("DOMContentLoaded", () => {
  const popup = document.getElementById("popup");
  let focused = null;
  new MutationObserver(() => {
    const lost = popup.ariaHidden === "false", main = document.querySelector(".ctl-main");
    if (!main || main.inert === lost) return;
    if (lost) focused = document.activeElement;
    main.inert = lost;
    main.style.opacity = lost ? 0.5 : "";
    if (!lost) focused?.focus();
  }).observe(popup, { attributes: true });
});

// A model file that is dropped anywhere on the page Model goes to its uploader, a table on any page to the page Data; else the browser
// would leave the page for it.
{
  let depth = 0;
  const files = (e) => e.dataTransfer?.types?.includes("Files");
  const over = (on) => document.querySelector(".ctl-model")?.classList.toggle("ctl-dropping", on);
  window.addEventListener("dragenter", (e) => { if (files(e)) { depth += 1; over(true); } });
  window.addEventListener("dragleave", (e) => { if (files(e) && --depth <= 0) { depth = 0; over(false); } });
  window.addEventListener("dragover", (e) => { if (files(e)) e.preventDefault(); });
  window.addEventListener("drop", (e) => {
    if (!files(e)) return;
    depth = 0;
    over(false);
    if (e.defaultPrevented || e.target.closest(".q-uploader")) return;
    e.preventDefault();
    const model = /\.toml$/i.test(e.dataTransfer.files[0]?.name ?? ".toml");
    const page = document.querySelector(model ? ".ctl-model" : ".ctl-anydrop");
    if (page) getElement(Number(page.dataset.uploader)).$refs.qRef.addFiles([e.dataTransfer.files[0]]);
  });
}

window.ctlabs = {
  // Another page is seen from its top, and what had the focus may be gone with the page before.
  top() {
    scrollTo(0, 0);
    setTimeout(() => {
      if (document.activeElement === document.body) document.querySelector(".ctl-main")?.focus({ preventScroll: true });
    }, 50);
  },
  // The help nearest to an element: its question mark is no stop of the Tab key.
  help(element) {
    for (let place = element; place && !place.matches(".ctl-main, body"); place = place.parentElement) {
      const button = place.querySelector(":scope button[data-test^=help-]");
      if (button) return button.click(), true;
    }
    return false;
  },
  // The server is told as soon as no field of the page has the focus.
  rest() {
    const field = document.activeElement?.closest?.(".ctl-main :is(input, textarea, [contenteditable])");
    if (!field) return emitEvent("ctlabs_rests");
    field.addEventListener("focusout", () => setTimeout(() => this.rest()), { once: true });
  },
  // Results that are elsewhere than where one looks are brought there; those that are seen stay where they are.
  bring(id) {
    const card = getHtmlElement(id), top = card?.getBoundingClientRect().top;
    if (top < 0 || top > innerHeight / 2) card.scrollIntoView({ block: "start" });
  },
  // The clipboard is there only on pages that are this machine's own or encrypted; selecting and copying works elsewhere too.
  async copy(text) {
    try { await navigator.clipboard.writeText(text); } catch {
      const area = document.body.appendChild(document.createElement("textarea"));
      area.value = text; area.select(); document.execCommand("copy"); area.remove();
    }
  },
  // An element is told whenever the page becomes light or dark; what draws figures is loaded meanwhile.
  watchTheme(id, last) {
    const look = (tries) => {
      const probe = getHtmlElement(id);
      if (!probe) return tries && setTimeout(() => look(tries - 1), 20);
      const tell = () => {
        if (!probe.isConnected) return watch.disconnect();
        const dark = document.body.classList.contains("body--dark");
        if (dark !== last) probe.dispatchEvent(new CustomEvent("theme", { detail: last = dark }));
      };
      const watch = new MutationObserver(tell);
      watch.observe(document.body, { attributes: true, attributeFilter: ["class"] });
      tell();
    };
    look(100);
    import("nicegui-plotly");
  },
};
