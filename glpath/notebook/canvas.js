// canvas.js: keyboard and screen reader support for the view's canvas, on top of the browser half of jupyter_rfb.
// Needs:  RFB, the text of jupyter_rfb's own script, which shows the image and handles the pointer. view.py adds it.
// Cost:   one more attribute and one more listener; nothing per frame.

const KEYS = ["ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown", "+", "=", "-", "_", "r", "R"];

export default async () => {
  const script = URL.createObjectURL(new Blob([RFB], { type: "text/javascript" }));
  const made = (await import(script)).default;
  URL.revokeObjectURL(script);
  const library = typeof made === "function" ? await made() : made;

  async function render(context) {
    const close = await library.render(context);
    const image = context.el.querySelector("img, canvas");
    const { model } = context;
    const name = () => {
      image.setAttribute("aria-label", model.get("label"));
      image.alt = model.get("label");
    };
    // Suppress Jupyter's shortcuts: arrow keys would change the cell, and R would make the cell raw.
    const attributes = { "role": "application", "aria-roledescription": "3D view", "data-lm-suppress-shortcuts": "true" };
    for (const [key, value] of Object.entries(attributes)) image.setAttribute(key, value);
    image.tabIndex = 0;
    name();
    model.on("change:label", name);

    const press = (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey || !KEYS.includes(event.key)) return;
      event.preventDefault();
      model.send({ type: "key_down", key: event.key, modifiers: event.shiftKey ? ["Shift"] : [], timestamp: performance.now() / 1000 });
    };
    image.addEventListener("keydown", press);
    // A click focuses an input of the library, which sends a key once, but does not repeat it while it is held down.
    const repeat = (event) => { if (event.repeat) press(event); };
    let input = null;
    image.addEventListener("pointerdown", () => {
      input?.removeEventListener("keydown", repeat);
      input = document.activeElement;
      input.addEventListener("keydown", repeat);
    });
    return () => {
      model.off("change:label", name);
      input?.removeEventListener("keydown", repeat);
      return close?.();
    };
  }

  return { ...library, render };
};
