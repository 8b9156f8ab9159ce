/** Mistakes that the types do not show. Run by `tools/javascript/check`. */

import js from "@eslint/js";
import globals from "globals";

export default [
  js.configs.recommended,
  {
    languageOptions: { ecmaVersion: 2024, sourceType: "module", globals: { ...globals.browser, ...globals.node } },
    rules: {
      eqeqeq: ["error", "always", { null: "ignore" }],
      "no-var": "error", "prefer-const": "error", "no-shadow": "error", "no-implicit-coercion": "error",
      "no-promise-executor-return": "off", "array-callback-return": "error", "no-self-compare": "error",
      "no-unused-expressions": "error", "no-use-before-define": ["error", { functions: false, classes: false, variables: false }],
      "max-len": ["error", { code: 220 }], semi: "error", quotes: ["error", "double", { avoidEscape: true }],
    },
  },
];
