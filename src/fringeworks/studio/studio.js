// The page beside the viewer: addresses, surfaces, live points and the list of captures.

(() => {
  "use strict";

  // Addresses. Links to places of the studio show them without loading the page anew.
  document.addEventListener("click", (event) => {
    const link = event.target.closest?.("a[data-place]");
    if (!link || event.ctrlKey || event.metaKey || event.shiftKey || event.altKey) return;
    event.preventDefault();
    const address = link.dataset.place;
    if (address !== location.pathname + location.search) history.pushState({}, "", address);
    globalThis.emitEvent("fw-place", address);
  });
  window.addEventListener("popstate", () => {
    globalThis.emitEvent("fw-place", location.pathname + location.search);
  });

  // The viewer is loaded when there is something to see.
  let viewer = null;
  const loaded = () => {
    viewer ??= new Promise((done, fail) => {
      const style = document.createElement("link");
      Object.assign(style, { rel: "stylesheet", href: "/viewer.css" });
      const script = document.createElement("script");
      Object.assign(script, { src: "/viewer.js", onload: done, onerror: fail });
      document.head.append(style, script);
    });
    return viewer;
  };
  const fetched = async (address, missing) => {
    const answer = await fetch(address);
    if (!answer.ok) throw new Error(missing);
    return new Uint8Array(await answer.arrayBuffer());
  };
  const release = (mount) => {
    // Browsers allow 16 pictures of the graphics processor: the old one is given back.
    for (const canvas of mount.querySelectorAll("canvas")) {
      canvas.getContext("webgl2")?.getExtension("WEBGL_lose_context")?.loseContext();
    }
    mount.replaceChildren();
  };

  globalThis.fringeShow = async (id, numbers) => {
    const gone = "The surface is no longer there: measure again.";
    const [, ...surfaces] = await Promise.all([
      loaded(),
      ...numbers.map((number) => fetched(`/surface/${number}`, gone)),
    ]);
    const mount = document.getElementById(id);
    if (!mount) return; // another step is shown by now
    release(mount);
    mount.viewer = new globalThis.FringeViewer(mount, surfaces);
    await mount.viewer.ready;
    document.dispatchEvent(new CustomEvent("fw-surface"));
  };

  globalThis.fringeLive = async (id, number) => {
    const mount = document.getElementById(id);
    if (!mount || mount.loading) return; // pictures that come while one is drawn are left out
    mount.loading = true;
    try {
      const [, bytes] = await Promise.all([loaded(), fetched(`/cloud/${number}`, "")]);
      if (mount.viewer?.header?.count) {
        await mount.viewer.replace(bytes);
      } else {
        release(mount);
        mount.viewer = new globalThis.FringeViewer(mount, [bytes]);
        await mount.viewer.ready;
      }
    } catch {
      // The next cloud comes soon.
    } finally {
      mount.loading = false;
    }
  };

  // The list of captures: drawn and searched here, so that hundreds stay quick.
  const EMPTY = "No capture or result is like that.";

  class Captures {
    constructor(list, rows) {
      this.list = list;
      this.rows = rows;
      this.chosen = rows[0]?.name ?? null;
      list.tabIndex = 0;
      list.addEventListener("keydown", (event) => this.pressed(event));
      list.addEventListener("click", (event) => {
        const row = event.target.closest("[role=option]");
        if (row) this.choose(row.dataset.name);
      });
      list.addEventListener("dblclick", () => this.tell("look"));
    }

    filter({ text = "", verdict = "", finding = "" }) {
      const words = text.toLowerCase().split(/\s+/).filter(Boolean);
      this.shown = this.rows.filter(
        (row) =>
          words.every((word) => row.name.toLowerCase().includes(word)) &&
          (!verdict || row.verdict === verdict) &&
          (!finding || row.findings.includes(finding)),
      );
      this.list.replaceChildren(...this.shown.map((row) => this.element(row)));
      if (!this.shown.length) this.list.textContent = EMPTY;
      const there = this.shown.some((row) => row.name === this.chosen);
      this.choose(there ? this.chosen : (this.shown[0]?.name ?? null));
      return this.shown.length;
    }

    element(row) {
      const element = document.createElement("div");
      element.setAttribute("role", "option");
      element.id = `fw-capture-${this.rows.indexOf(row)}`;
      element.dataset.name = row.name;
      const picture = document.createElement("img");
      Object.assign(picture, { alt: "", loading: "lazy", decoding: "async" });
      if (row.picture) picture.src = row.picture;
      const words = document.createElement("div");
      const name = document.createElement("div");
      name.className = "fw-name";
      name.textContent = row.name;
      const tags = document.createElement("div");
      tags.className = "fw-tags";
      tags.textContent = row.said;
      words.append(name, tags);
      element.append(picture, words);
      return element;
    }

    choose(name) {
      this.chosen = name;
      for (const element of this.list.querySelectorAll("[role=option]")) {
        const chosen = element.dataset.name === name;
        element.setAttribute("aria-selected", String(chosen));
        if (!chosen) continue;
        this.list.setAttribute("aria-activedescendant", element.id);
        element.scrollIntoView({ block: "nearest" });
      }
      if (name === null) this.list.removeAttribute("aria-activedescendant");
      this.tell("chosen");
    }

    pressed(event) {
      const place = this.shown.findIndex((row) => row.name === this.chosen);
      const last = this.shown.length - 1;
      const page = 8;
      const to = {
        ArrowDown: place + 1,
        ArrowUp: place - 1,
        PageDown: place + page,
        PageUp: place - page,
        Home: 0,
        End: last,
      }[event.key];
      const does = { Enter: "look", Delete: "delete", F2: "rename" }[event.key];
      if (to === undefined && !does) return;
      event.preventDefault();
      if (does) this.tell(does);
      else if (last >= 0) this.choose(this.shown[Math.min(Math.max(to, 0), last)].name);
    }

    tell(does) {
      globalThis.emitEvent("fw-capture", [does, this.chosen]);
    }
  }

  globalThis.fringeCaptures = (id, rows, asked) => {
    const list = document.getElementById(id);
    if (!list) return;
    if (rows) {
      const before = list.captures?.chosen;
      list.captures ??= new Captures(list, rows);
      list.captures.rows = rows;
      if (before && rows.some((row) => row.name === before)) list.captures.chosen = before;
    }
    list.asked = asked ?? list.asked ?? {};
    list.captures.filter(list.asked);
  };
})();
