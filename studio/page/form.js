// The form of methods and parameters, made from what the service says it takes.

import { make } from "./dom.js";
import { METHODS, OF_OUTPUT, TARGETS } from "./methods.js";

/** @typedef {import("./api.js").Methods} Methods */
/** @typedef {import("./api.js").Parameters} Parameters */
/** @typedef {Methods["parameters"][number] & { default?: unknown }} Parameter */

export class Form {
  /**
   * @param {HTMLFormElement} form @param {Methods} methods @param {() => void} onChange
   */
  constructor(form, methods, onChange) {
    this.form = form;
    this.methods = methods;
    this.method = this.methodSelect("method");
    this.compared = this.methodSelect("compared");
    this.compared.prepend(new Option("nothing", ""));
    this.compared.value = "";
    const [target, amount] = this.targetFields();
    this.target = target;
    this.amount = amount;
    this.about = make("p", { class: "note", id: "method-about" });
    this.method.setAttribute("aria-describedby", "method-about");
    /** @type {Map<string, HTMLInputElement | HTMLSelectElement>} */
    this.others = new Map();
    this.unit = make("span", { class: "note" });
    this.build();
    this.describe();
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      onChange();
    });
    form.addEventListener("change", () => {
      this.describe();
      if (form.checkValidity()) onChange();
    });
  }

  /** @param {string} name */
  methodSelect(name) {
    const select = make("select", { id: `${name}-select`, name });
    for (const { name: value, components } of this.methods.methods) {
      if (value === "preview") continue;
      const known = METHODS[value]?.title;
      const kind = components === 1 ? ", gray" : components === 3 ? ", colour" : "";
      select.append(new Option(known ? `${value} · ${known}${kind}` : value, value));
    }
    select.value = this.methods.default;
    return select;
  }

  /** @returns {[HTMLSelectElement, HTMLInputElement]} */
  targetFields() {
    const target = make("select", { id: "target-select" });
    for (const { name } of this.methods.parameters) {
      if (name in TARGETS) target.append(new Option(TARGETS[name].title, name));
    }
    const amount = make("input", { id: "amount", type: "number", required: true });
    target.addEventListener("change", () => {
      amount.value = TARGETS[target.value].start;
      this.bound();
    });
    const defaults = this.methods.methods.find(({ name }) => name === this.methods.default)?.defaults;
    amount.value = String(/** @type {Record<string, unknown>} */ (defaults ?? {}).density ?? TARGETS.density.start);
    return [target, amount];
  }

  /** Gives the field of the amount the bounds of what is asked for. */
  bound() {
    const parameter = this.methods.parameters.find(({ name }) => name === this.target.value);
    this.amount.min = String(parameter?.minimum ?? 0);
    this.amount.max = String(parameter?.maximum ?? "");
    this.amount.step = parameter?.type === "integer" ? "1" : "any";
    this.unit.textContent = TARGETS[this.target.value]?.unit ?? "";
  }

  build() {
    /** @param {string} text @param {HTMLElement} control @param {Node[]} more */
    const field = (text, control, ...more) => {
      return make("div", { class: "field" }, make("label", { for: control.id }, text), control, ...more);
    };
    const fields = make("div", { class: "fields" });
    for (const parameter of this.methods.parameters) {
      const { name } = parameter;
      if (name === "method" || name in TARGETS || OF_OUTPUT.has(name)) continue;
      const control = controlOf(parameter);
      this.others.set(name, control);
      const about = make("p", { class: "note", id: `about-${name}` }, `${parameter.about}${boundsOf(parameter)}`);
      control.setAttribute("aria-describedby", about.id);
      fields.append(field(name.replaceAll("_", " "), control, about));
    }
    const amount = field("At", this.amount);
    this.form.append(
      field("Method", this.method, this.about),
      make("div", { class: "pair" }, field("Ask for", this.target), amount),
      this.unit,
      field("Compare with", this.compared),
      make("details", {}, make("summary", {}, "Every parameter"), fields),
      make("p", { class: "row" }, make("button", { type: "submit", class: "primary", id: "run" }, "Make the mesh")),
    );
    this.bound();
  }

  /** Says what is chosen, and what the method sets the other parameters to. */
  describe() {
    const name = this.method.value;
    this.about.textContent = METHODS[name]?.about ?? "";
    const method = this.methods.methods.find((known) => known.name === name);
    const defaults = /** @type {Record<string, unknown>} */ (method?.defaults ?? {});
    for (const [parameter, control] of this.others) {
      const value = defaults[parameter];
      const text = value === undefined ? "" : String(value);
      if (control instanceof HTMLSelectElement) control.options[0].text = text ? `as the method: ${text}` : "not set";
      else control.placeholder = text;
    }
  }

  /** What is asked for. @returns {Parameters} */
  parameters() {
    /** @type {Parameters} */
    const parameters = { method: this.method.value, [this.target.value]: this.amount.value };
    for (const [name, control] of this.others) if (control.value !== "") parameters[name] = control.value;
    return parameters;
  }

  /** The method to compare with; empty for none. */
  get comparedMethod() {
    return this.compared.value;
  }

  /** Fills in what an address asks for; what is not known is left out. @param {URLSearchParams} asked */
  fill(asked) {
    put(this.method, asked.get("method"));
    put(this.compared, asked.get("compare"));
    for (const name of Object.keys(TARGETS)) {
      const amount = asked.get(name);
      if (amount === null || !Number.isFinite(Number(amount))) continue;
      put(this.target, name);
      this.amount.value = amount;
    }
    for (const [name, control] of this.others) if (asked.has(name)) put(control, asked.get(name));
    this.bound();
    this.describe();
  }
}

/** @param {HTMLSelectElement | HTMLInputElement} control @param {string | null} value */
function put(control, value) {
  if (value === null) return;
  if (control instanceof HTMLInputElement || [...control.options].some((option) => option.value === value)) control.value = value;
}

/** @param {Parameter} parameter */
function controlOf({ name, type, minimum, maximum, allowed }) {
  const id = `parameter-${name}`;
  const words = type === "boolean" ? ["true", "false"] : allowed;
  if (words) {
    const select = make("select", { id });
    select.append(new Option("", ""), ...words.map((word) => new Option(word, word)));
    return select;
  }
  if (type === "string") return make("input", { id, type: "text", spellcheck: "false" });
  const step = type === "integer" ? "1" : "any";
  return make("input", { id, type: "number", min: String(minimum), max: String(maximum), step });
}

/** @param {Parameter} parameter */
function boundsOf({ minimum, maximum }) {
  return minimum === undefined ? "" : ` From ${minimum} to ${maximum}.`;
}
