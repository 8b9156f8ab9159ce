/** The one widget for a number: a field that shows its value and takes a new one, its unit, a slider over its range. */

import { el } from "./dom.js";
import { numberText, unitOf } from "./presentation.js";

const SLIDER_STEPS = 500;  // steps

/** @typedef {{name?: string, look?: string, digits?: number | null, minimum?: number, maximum?: number, range?: string}} About */

/** @param {About} about */
const bounded = ({ minimum, maximum }) => Number.isFinite(minimum) && Number.isFinite(maximum);

/** What is outside of the range is refused by the machine, in its words. */
export class NumberInput {
  /**
   * @param {About} about @param {string} label  For those who hear it.
   * @param {{value?: string | number, slide?: ((value: number, done: boolean) => void) | null, unit?: boolean}} [how]
   *   `slide`: called while the slider is moved and when it is let go of; null: there is none. `unit`: whether it
   *   stands behind the field.
   */
  constructor(about, label, { value = "", slide = null, unit = true } = {}) {
    const range = about.range ?? "";
    const title = [range, unitOf(about)].filter(Boolean).join(" ");
    this.field = el("input", { type: "number", step: "any", value, placeholder: range, title, "aria-label": label });
    for (const event of ["focus", "pointerdown", "keydown", "input"]) this.field.addEventListener(event, () => { this._edited = true; });
    this.field.addEventListener("blur", () => { this._edited = false; });
    this._edited = false;
    this._digits = about.digits;
    /** The present value, and its text in the field, which has fewer digits. */
    this._shown = { text: "", value: 0 };
    this.slider = slide && bounded(about) ? this._slider(about, label, slide) : null;
    this.element = el("span", { className: "number" }, this.field, unit && unitOf(about) ? el("span", { className: "unit", textContent: unitOf(about) }) : null, this.slider);
  }

  /** @param {About} about @param {string} label @param {(value: number, done: boolean) => void} slide */
  _slider(about, label, slide) {
    const { minimum = 0, maximum = 0 } = about;
    const slider = el("input", { type: "range", min: minimum, max: maximum, step: (maximum - minimum) / SLIDER_STEPS || "any", title: about.range, "aria-label": `${label}, slider` });
    slider.oninput = () => {
      this.field.value = numberText(Number(slider.value), about.digits);
      slide(Number(slider.value), false);
    };
    slider.onchange = () => slide(Number(slider.value), true);
    return slider;
  }

  /** What is given; null: nothing. The present value is given with all of its digits. */
  get value() {
    const { text, value } = this._shown;
    if (this.field.value === "") return null;
    return this.field.value === text ? value : Number(this.field.value);
  }

  /** Show the present value, unless a new one is being given. @param {number | null} value */
  show(value) {
    const busy = document.activeElement;
    if (value === null || busy === this.slider || (busy === this.field && this._edited)) return;
    const text = numberText(value, this._digits);
    if (this.field.value !== text) {
      this.field.value = text;
      if (busy === this.field) this.field.select(); // what is typed next takes the place of all of it
    }
    this._shown = { text, value };
    if (this.slider) this.slider.value = String(value);
  }

  /** The value was taken: what comes next is shown. */
  taken() { this._edited = false; }

  /** @param {boolean} enabled */
  enable(enabled) {
    this.field.disabled = !enabled;
    if (this.slider) this.slider.disabled = !enabled;
  }
}
