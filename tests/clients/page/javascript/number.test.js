/** The widget for a number, over elements that keep what they are given. node --test. */

import assert from "node:assert/strict";
import { test } from "node:test";
import { NumberInput } from "../../../../src/umo/clients/page/static/number.js";

globalThis.document = {
  activeElement: {},
  createElement: () => ({ value: "", addEventListener() {}, append() {}, setAttribute() {} }),
};

test("the present value is given with all of its digits, what is typed as it is typed", () => {
  const input = new NumberInput({ unit: "V" }, "gain");
  assert.equal(input.value, null);
  input.show(0.0042178934);
  assert.equal(input.field.value, "0.00421789");
  assert.equal(input.value, 0.0042178934);
  input.field.value = "0.005";
  assert.equal(input.value, 0.005);
});
