/** Small helpers: elements, the address, files. */

/**
 * An element with properties, attributes (`data-`, `aria-`, role) and children.
 * @template {keyof HTMLElementTagNameMap} T
 * @param {T} tag @param {Record<string, unknown>} properties @param {(Node | string | null | undefined)[]} children
 * @returns {HTMLElementTagNameMap[T]}
 */
export function el(tag, properties = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (name in element && !name.includes("-") && !["list", "role"].includes(name)) /** @type {any} */ (element)[name] = value;
    else if (value !== null && value !== undefined) element.setAttribute(name, String(value));
  }
  element.append(...children.filter((child) => child !== null && child !== undefined));
  return element;
}

/** Set the text of an element if it differs: nothing is laid out again for nothing. @param {Element} element @param {string} text */
export function setText(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

/** Let a button be used, or say why it cannot be, also to those who hear the page. @param {HTMLButtonElement} button @param {string} reason  "": it can be used. @param {string} [help] */
export function allow(button, reason, help = "") {
  const title = [reason, help].filter(Boolean).join(". ");
  button.disabled = Boolean(reason);
  if (button.title !== title) button.title = title;
}

/** A name that is broken after its dots and underscores only. @param {string} name @returns {Node[]} */
export function breakable(name) {
  const parts = name.split(/(?<=[._])/);
  return parts.flatMap((part, i) => (i ? [el("wbr"), new Text(part)] : [new Text(part)]));
}

/** What is chosen, kept in the address after `#`. */
export const address = {
  /** @param {string} name */
  get(name) { return new URLSearchParams(location.hash.slice(1)).get(name); },
  /** @param {Record<string, string | null>} values  null: not kept. */
  set(values) {
    const all = new URLSearchParams(location.hash.slice(1));
    for (const [name, value] of Object.entries(values)) {
      if (value === null || value === "") all.delete(name);
      else all.set(name, value);
    }
    history.replaceState(null, "", `${location.pathname}#${all.toString().replaceAll("%2C", ",")}`);
  },
};

/** What is kept on this computer; nothing in a browser without storage. */
export const store = {
  /** @param {string} name */
  get(name) {
    try { return localStorage.getItem(`umo-${name}`) ?? ""; } catch { return ""; }
  },
  /** @param {string} name @param {string} value */
  set(name, value) {
    try { localStorage.setItem(`umo-${name}`, value); } catch { /* no storage */ }
  },
};

/** The paths on the scope, as the address has them; null: nothing was chosen yet. @returns {string[] | null} */
export function tracesOfAddress() {
  const text = address.get("traces");
  return text === null ? null : text.split(",").filter(Boolean);
}

/** Offer a file for saving. @param {string} name @param {Blob} blob */
export function save(name, blob) {
  const link = el("a", { href: URL.createObjectURL(blob), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}
