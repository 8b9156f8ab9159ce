/** What is not good stands first, and stays there for a while; values of recipes in words. node --test. */

import assert from "node:assert/strict";
import { test } from "node:test";
import { recipeText } from "../../../../src/umo/clients/page/static/recipes.js";
import { Trouble } from "../../../../src/umo/clients/page/static/trouble.js";

test("a value that is not good stands first until it was good for a while", () => {
  const trouble = new Trouble();
  const look = (qualities, now) => {
    trouble.look(qualities.map((quality, place) => [place, quality]), now);
    return trouble.places;
  };
  assert.deepEqual(look([0, 0, 0], 0), []);
  assert.deepEqual(look([0, 4, 0], 1), [1]);
  assert.deepEqual(look([3, 0, 0], 2), [0, 1]);
  assert.deepEqual(look([3, 0, 0], 6), [0, 1]);
  assert.deepEqual(look([0, 0, 0], 6.5), [0]);
  assert.deepEqual(look([0, 0, 0], 12), []);
});

test("one that comes and goes stays where it is", () => {
  const trouble = new Trouble();
  for (let now = 0; now < 100; now += 1) {
    trouble.look([[0, 0], [1, now % 2]], now);
    if (now) assert.deepEqual(trouble.places, [1]);
  }
});

test("a value of a recipe is shown as it was given", () => {
  assert.deepEqual([60, 0.1, [40, 20.5], true, false, "RED", "", null].map(recipeText), ["60", "0.1", "40, 20.5", "yes", "no", "RED", "", "-"]);
});
