/** The twin: a placeholder. @param {HTMLElement} element */
export function mount(element) {
  element.textContent = "This station has no twin.";
}

export function unmount() {}
