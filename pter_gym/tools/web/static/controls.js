// The form of the settings: filled from them, and told when a person changes one.

import { CONTROLS, DEFAULTS, FRICTION, LAG, MATERIALS, PATHS } from "./settings.js";

const byId = (id) => document.getElementById(id);

/** Makes the form once; `changed(name, value)` is called with what a person chooses. */
export class Controls {
  constructor({ paces, clutches }, changed) {
    fillGroups(byId("control"), CONTROLS);
    fillGroups(byId("other"), CONTROLS, ["sliders"]);
    fillOptions(byId("path"), PATHS);
    fillOptions(byId("material"), MATERIALS);
    fillOptions(byId("pace"), Object.fromEntries(Object.entries(paces).map(([name, pace]) => [name, `${name === "own" ? "yours" : name}, ${pace} m/s`])));
    for (const name of ["control", "other", "path", "material", "pace"]) {
      byId(name).addEventListener("change", (event) => changed(name, event.target.value));
    }
    Object.assign(byId("lag"), { min: LAG.low, max: LAG.high });
    Object.assign(byId("friction"), { min: FRICTION.low, max: FRICTION.high });
    for (const name of ["lag", "friction"]) {
      byId(name).addEventListener("input", () => this.#tell(name, byId(name).value));
      byId(name).addEventListener("change", () => changed(name, Number(byId(name).value)));
    }
    for (const radio of document.getElementsByName("hand")) radio.addEventListener("change", () => changed("hand", radio.value));
    byId("settings").addEventListener("submit", (event) => event.preventDefault());
    const volts = () => DEFAULTS.volts.map((none, k) => Number(this.sliders[k]?.value ?? none));
    this.sliders = clutches.map(({ name, colour }, k) => slider(k, name, colour, () => changed("volts", volts())));
  }

  /** Show settings in the form. */
  show(settings) {
    for (const name of ["control", "other", "path", "material", "pace", "lag", "friction"]) byId(name).value = settings[name];
    for (const radio of document.getElementsByName("hand")) radio.checked = radio.value === settings.hand;
    for (const name of ["lag", "friction"]) this.#tell(name, settings[name]);
    byId("volts").hidden = settings.control !== "sliders";
    this.sliders.forEach((each, k) => {
      each.value = settings.volts[k];
      each.previousElementSibling.textContent = `${settings.volts[k]} V`;
    });
  }

  #tell(name, value) {
    byId(`${name}-shown`).textContent = name === "lag" ? `${value} ms` : `× ${Number(value).toFixed(2)}`;
  }
}

function fillOptions(parent, names) {
  for (const [value, text] of Object.entries(names)) parent.append(new Option(text, value));
}

function fillGroups(select, groups, without = []) {
  for (const [label, names] of Object.entries(groups)) {
    const kept = Object.fromEntries(Object.entries(names).filter(([name]) => !without.includes(name)));
    if (Object.keys(kept).length === 0) continue;
    const group = Object.assign(document.createElement("optgroup"), { label });
    fillOptions(group, kept);
    select.append(group);
  }
}

function slider(k, meaning, colour, moved) {
  const label = document.createElement("label");
  const input = Object.assign(document.createElement("input"), { type: "range", min: 0, max: 24, step: 0.5, id: `volts-${k + 1}` });
  input.style.accentColor = `var(--${colour})`;
  const shown = document.createElement("output");
  label.htmlFor = input.id;
  input.addEventListener("input", () => {
    shown.textContent = `${input.value} V`;
    moved();
  });
  label.append(`${k + 1}, ${meaning} `, shown, input);
  byId("volts").append(label);
  return input;
}
