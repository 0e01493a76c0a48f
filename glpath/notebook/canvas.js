// canvas.js: the view's canvas for those who use keys, or a reader of the screen: both halves of the widget in the page.
// Needs:  RFB, the text of jupyter_rfb's own script, which shows the image and hears the pointer. view.py puts it here.
// Cost:   one attribute and one listener more; nothing a frame.

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
    // Jupyter's shortcuts would take the keys: the arrows go from cell to cell, R makes a cell raw.
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
    // A click gives the focus to an input of the library's, which sends keys, but not again while they are held down.
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
