/** The ranges of the lanes: a click on an axis lets its least and greatest number be typed; another one gives it back. */

import { rangesFromAddress, rangesToAddress, rangeText, refusal } from "./axes.js";
import { pixelRatio } from "./canvas.js";
import { address, el, setText } from "./dom.js";
import { numberText } from "./presentation.js";

/** @typedef {import("./axes.js").Axis} Axis */

export class Ranges {
  /** @param {HTMLElement} plot  In which they stand. @param {() => void} changed */
  constructor(plot, changed) {
    this._changed = changed;
    this.fixed = rangesFromAddress(address.get("ranges"));
    /** @type {Axis | null} */
    this._asked = null;
    /** @type {import("./chart.js").Chart | null} */
    this._chart = null;
    this._controls = el("div", { className: "ranges" });
    const field = (/** @type {string} */ label) => el("input", { type: "number", step: "any", required: true, "aria-label": `${label} number of the axis` });
    this._least = field("Least");
    this._most = field("Greatest");
    this._unit = el("span", { className: "unit" });
    this._wrong = el("span", { className: "failed", role: "alert" });
    this._form = el("form", { className: "range-form", hidden: true, noValidate: true, "aria-label": "Range of the axis", onsubmit: (/** @type {Event} */ event) => this._typed(event) },
      el("label", {}, "from", this._least), el("label", {}, "to", this._most), this._unit,
      el("button", { textContent: "Set", type: "submit" }),
      el("button", { textContent: "Automatic", type: "button", onclick: () => this._set(null) }), this._wrong);
    this._form.addEventListener("keydown", (event) => {
      if (event.key !== "Escape") return;
      event.stopPropagation();
      this._close();
    });
    plot.append(this._controls, this._form);
  }

  /** Stand beside the lanes of this chart. @param {import("./chart.js").Chart} chart */
  place(chart) {
    this._chart = chart;
    const focused = this._controls.contains(document.activeElement) ? /** @type {HTMLElement} */ (document.activeElement).dataset.axis : undefined;
    this._controls.replaceChildren(...chart.axes.flatMap((axis) => this._controlsOf(chart, axis)));
    if (focused !== undefined) this._button(focused)?.focus();
    if (this._asked && !chart.axes.some(({ key }) => key === this._asked?.key)) this._close();
  }

  /** @param {string} key  Of an axis. */
  _button(key) { return [.../** @type {NodeListOf<HTMLElement>} */ (this._controls.querySelectorAll(".axis-range"))].find((each) => each.dataset.axis === key); }

  /** The axis, which can be clicked; beside a range that is fixed what it is. @param {import("./chart.js").Chart} chart @param {Axis} axis */
  _controlsOf(chart, axis) {
    const fixed = this.fixed.get(axis.key);
    const box = chart.laneBox(axis);
    const [left, top, width, height] = [box.left, box.top, box.width, box.height].map((pixels) => pixels / pixelRatio());
    const title = `Range of ${axis.name}: ${fixed ? `fixed, ${rangeText(fixed)}` : "automatic"}`;
    const button = el("button", { className: "axis-range", type: "button", title: `${title}. A click fixes it.`, "aria-label": title, "data-axis": axis.key, onclick: () => this._ask(axis) });
    Object.assign(button.style, { left: "0px", top: `${top}px`, width: `${left}px`, height: `${height}px` });
    if (!fixed) return [button];
    const back = el("button", { className: "axis-fixed", type: "button", "data-axis": axis.key, title: "Back to the automatic range", "aria-label": `Automatic range of ${axis.name}` },
      `fixed: ${rangeText(fixed)} ${axis.unit} `, el("b", { textContent: "×" }));
    back.addEventListener("click", () => this._set(null, axis));
    Object.assign(back.style, { top: `${top + 3}px`, left: `${left + width - 6}px` });
    return [button, back];
  }

  /** @param {Axis} axis */
  _ask(axis) {
    const chart = /** @type {import("./chart.js").Chart} */ (this._chart);
    const [least, most] = chart.shown.get(axis.key) ?? [0, 1];
    const { left, top } = chart.laneBox(axis);
    this._asked = axis;
    this._least.value = numberText(least);
    this._most.value = numberText(most);
    setText(this._unit, axis.unit);
    setText(this._wrong, "");
    this._form.hidden = false;
    const [beside, below] = [left / pixelRatio() + 6, top / pixelRatio() + 20];
    const isLow = below + this._form.offsetHeight > /** @type {HTMLElement} */ (this._form.parentElement).clientHeight;
    Object.assign(this._form.style, { left: `${beside}px`, top: isLow ? "auto" : `${below}px`, bottom: isLow ? "4px" : "auto" });
    this._least.focus();
    this._least.select();
  }

  /** @param {Event} event */
  _typed(event) {
    event.preventDefault();
    const [least, most] = [this._least, this._most].map((field) => field.valueAsNumber);
    const wrong = refusal(least, most);
    setText(this._wrong, wrong);
    if (!wrong) this._set([least, most]);
  }

  /** @param {import("./axes.js").Range | null} range  null: automatic. */
  _set(range, axis = this._asked) {
    if (!axis) return;
    if (range) this.fixed.set(axis.key, range);
    else this.fixed.delete(axis.key);
    address.set({ ranges: rangesToAddress(this.fixed) });
    this._close();
    if (this._chart) this.place(this._chart);
    this._button(axis.key)?.focus();
    this._changed();
  }

  _close() {
    this._form.hidden = true;
    if (this._asked) this._button(this._asked.key)?.focus();
    this._asked = null;
  }
}
