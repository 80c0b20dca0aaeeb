// The amount of detail, and under Advanced every parameter, made from what the service says it takes.

import { make } from "./dom.js";
import { GROUPS, METHODS, OF_OUTPUT, TARGETS } from "./methods.js";

/** @typedef {import("./api.js").Methods} Methods */
/** @typedef {import("./api.js").Parameters} Parameters */
/** @typedef {Methods["parameters"][number] & { default?: unknown }} Parameter */

export class Form {
  /**
   * @param {HTMLFormElement} form @param {Methods} methods
   * @param {(isAsked: boolean) => void} onChange  Something is set, or the button is pressed.
   */
  constructor(form, methods, onChange) {
    this.form = form;
    this.methods = methods;
    this.method = this.methodSelect("method");
    this.compared = this.methodSelect("compared");
    this.compared.prepend(new Option("Nothing", ""));
    this.compared.value = "";
    const [target, amount] = this.targetFields();
    this.target = target;
    this.amount = amount;
    this.about = make("p", { class: "note", id: "method-about" });
    this.method.setAttribute("aria-describedby", "method-about");
    /** @type {Map<string, HTMLInputElement | HTMLSelectElement>} */
    this.others = new Map();
    this.build();
    this.describe();
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      onChange(true);
    });
    form.addEventListener("change", ({ target }) => {
      // Another method has its own parameters.
      if (target === this.method) for (const [name, control] of this.others) if (!isOfPicture(name)) control.value = "";
      this.describe();
      if (form.checkValidity()) onChange(false);
    });
  }

  /** @param {string} name */
  methodSelect(name) {
    const select = make("select", { id: `${name}-select`, name });
    for (const { name: value } of this.methods.methods) {
      const known = METHODS[value]?.title;
      select.append(new Option(known ? `${known} (${value})` : value, value));
    }
    select.value = this.methods.default;
    return select;
  }

  /** @returns {[HTMLSelectElement, HTMLInputElement]} */
  targetFields() {
    const target = make("select", { id: "target-select", "aria-label": "Unit of the detail" });
    for (const { name } of this.methods.parameters) {
      if (name in TARGETS) target.append(new Option(TARGETS[name].title, name));
    }
    const amount = make("input", { id: "amount", type: "number", required: true });
    target.addEventListener("change", () => {
      amount.value = TARGETS[target.value].start;
      this.bound();
    });
    amount.value = TARGETS.density.start;
    return [target, amount];
  }

  /** Gives the field of the amount the bounds of what is asked for. */
  bound() {
    const parameter = this.methods.parameters.find(({ name }) => name === this.target.value);
    this.amount.min = String(parameter?.minimum ?? 0);
    this.amount.max = String(parameter?.maximum ?? "");
    this.amount.step = parameter?.type === "integer" ? "1" : "any";
  }

  build() {
    /** @param {string} text @param {HTMLElement} control @param {Node[]} more */
    const field = (text, control, ...more) => {
      return make("div", { class: "field" }, make("label", { for: control.id }, text), control, ...more);
    };
    const groups = new Map([...Object.keys(GROUPS), "More"].map((title) => [title, make("div", { class: "fields" })]));
    for (const parameter of this.methods.parameters) {
      const { name } = parameter;
      if (name === "method" || name === "preset" || name in TARGETS || OF_OUTPUT.has(name)) continue;
      const control = controlOf(parameter);
      this.others.set(name, control);
      const about = make("p", { class: "note", id: `about-${name}` }, `${parameter.about}${boundsOf(parameter)} (${name})`);
      control.setAttribute("aria-describedby", about.id);
      const [title, names] = Object.entries(GROUPS).find(([, names]) => name in names) ?? ["More", {}];
      groups.get(title)?.append(field(names[name] ?? name.replaceAll("_", " "), control, about));
    }
    const titled = [...groups].filter(([, fields]) => fields.children.length).map(([title, fields]) => {
      return make("details", { class: "group-of-fields" }, make("summary", {}, title), fields);
    });
    this.form.append(
      make("div", { class: "field" }, make("label", { for: "amount" }, "Detail"), make("div", { class: "pair" }, this.amount, this.target)),
      make("details", { id: "advanced" }, make("summary", {}, "Advanced"), make("div", { class: "fields" },
        field("Method", this.method, this.about), field("Compare with", this.compared), ...titled)),
      make("p", { class: "row" }, make("button", { type: "submit", class: "wide", id: "run" }, "Make it again")),
    );
    this.bound();
  }

  /** Says what is chosen, and what the method sets the other parameters to. */
  describe() {
    this.about.textContent = METHODS[this.method.value]?.about ?? "";
    const defaults = this.defaults(this.method.value);
    for (const [parameter, control] of this.others) {
      const value = defaults[parameter];
      const text = value === undefined ? "" : String(value);
      if (control instanceof HTMLSelectElement) control.options[0].text = text ? `Default (${text})` : "Not set";
      else control.placeholder = text;
    }
  }

  /** What a method sets the other parameters to. @param {string} name @returns {Record<string, unknown>} */
  defaults(name) {
    return /** @type {Record<string, unknown>} */ (this.methods.methods.find((known) => known.name === name)?.defaults ?? {});
  }

  /** Offers the methods that there are for a picture. @param {number} components  Without alpha. */
  allow(components) {
    for (const select of [this.method, this.compared]) {
      for (const option of select.options) {
        const known = this.methods.methods.find(({ name }) => name === option.value);
        const isFor = !known || known.components == null || known.components === components;
        option.disabled = !isFor;
        option.title = isFor ? "" : `For ${known?.components === 1 ? "gray" : "colour"} pictures only`;
      }
    }
  }

  /** What is asked for; of a method that is not chosen, without the other's parameters. @returns {Parameters} */
  parameters(method = this.method.value) {
    /** @type {Parameters} */
    const parameters = { method, [this.target.value]: this.amount.value };
    for (const [name, control] of this.others) {
      if (control.value !== "" && (method === this.method.value || isOfPicture(name))) parameters[name] = control.value;
    }
    return parameters;
  }

  /** The same with a format that keeps every size, where the mesh has an order. @param {Parameters} parameters @returns {Parameters} */
  ordered(parameters) {
    const whole = { ...this.defaults(parameters.method), ...parameters };
    const hasNone = whole.reconstruction === "flat" || whole.connectivity === "free" || whole.values === "fitted";
    return hasNone ? parameters : { ...parameters, format: "progression" };
  }

  /** The method to compare with; empty for none. */
  get comparedMethod() {
    return this.compared.value;
  }

  /** Sets everything as some parameters say, and the rest to its defaults. @param {Parameters} parameters */
  reset(parameters) {
    for (const control of this.others.values()) control.value = "";
    this.fill(new URLSearchParams(parameters));
  }

  /** Fills in what an address asks for; what is not known is left out. @param {URLSearchParams} asked */
  fill(asked) {
    put(this.method, asked.get("method"));
    put(this.compared, asked.get("compare"));
    for (const name of Object.keys(TARGETS)) {
      const amount = asked.get(name);
      if (amount === null || !Number.isFinite(Number(amount))) continue;
      this.ask(name, amount);
    }
    for (const [name, control] of this.others) if (asked.has(name)) put(control, asked.get(name));
    this.describe();
  }

  /** Asks for an amount. @param {string} target @param {string} amount */
  ask(target, amount) {
    put(this.target, target);
    this.amount.value = amount;
    this.bound();
  }
}

/** @param {string} name */
const isOfPicture = (name) => name in GROUPS["The picture"];

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
