// SPDX-FileCopyrightText: 2026 the CDFF contributors
// SPDX-License-Identifier: BSD-3-Clause
// Shows the OpenAPI document to people, without anything from another host.
"use strict";

function element(tag, attributes, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes || {})) made.setAttribute(name, value);
  made.append(...children);
  return made;
}

function parameter(p) {
  const needed = p.required ? ", required" : "";
  const standard = p.schema && p.schema.default !== undefined && p.schema.default !== null ? `, default ${p.schema.default}` : "";
  return element("li", null, element("code", null, p.name), ` (${p.in}${needed}${standard}) ${p.description || ""}`);
}

const LONGEST_ANSWER = 20000;

/** Send a GET request with the values of a form, and show its address, status and answer. */
async function send(path, form, output) {
  const values = [...form.querySelectorAll("input")];
  const filled = path.replace(/{(\w+)}/g, (_, name) => encodeURIComponent(values.find((i) => i.name === name && i.dataset.in === "path")?.value ?? ""));
  const query = values.filter((i) => i.dataset.in === "query" && i.value !== "").map((i) => `${encodeURIComponent(i.name)}=${encodeURIComponent(i.value)}`).join("&");
  const address = query ? `${filled}?${query}` : filled;
  const key = sessionStorage.getItem("cdff-key");
  const control = new AbortController();
  try {
    const answer = await fetch(address.slice(1), { headers: key ? { Authorization: `Bearer ${key}` } : {}, signal: control.signal });
    const type = answer.headers.get("Content-Type") || "";
    let text = `${type}, ${answer.headers.get("Content-Length") || "?"} bytes`;
    if (/event-stream/.test(type)) control.abort();
    else if (/json|text|xml/.test(type)) {
      text = await answer.text();
      if (/json/.test(type) && text.length < LONGEST_ANSWER) text = JSON.stringify(JSON.parse(text), null, 1);
    }
    output.textContent = `GET ${address}\n${answer.status} ${answer.statusText}\n\n${text.slice(0, LONGEST_ANSWER)}`;
  } catch (error) {
    output.textContent = `GET ${address}\n${error.message}`;
  }
  output.hidden = false;
}

/** A form with a field for each parameter of a GET operation. */
function trial(path, parameters) {
  const fields = parameters.filter((p) => p.in === "path" || p.in === "query").map((p) => {
    const input = element("input", { name: p.name, "data-in": p.in, autocomplete: "off", spellcheck: "false" });
    input.required = p.in === "path";
    return element("label", null, p.name, " ", input);
  });
  const output = element("pre", { class: "answer" });
  output.hidden = true;
  const form = element("form", { class: "filter" }, ...fields, element("button", { type: "submit" }, "Send"));
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    send(path, form, output);
  });
  return [form, output];
}

function operation(verb, path, described) {
  const head = element("summary", null, element("span", { class: "verb" }, verb.toUpperCase()), element("code", null, path),
    element("span", null, described.summary || ""));
  const body = [element("p", null, described.description || "")];
  if (described.parameters) body.push(element("ul", null, ...described.parameters.map(parameter)));
  const details = element("details", null, head, ...body);
  if (verb === "get") {
    details.addEventListener("toggle", () => details.append(...trial(path, described.parameters || [])), { once: true });
  }
  return details;
}

async function show() {
  const document_ = await (await fetch("openapi.json")).json();
  const found = [];
  for (const [path, verbs] of Object.entries(document_.paths)) {
    for (const [verb, described] of Object.entries(verbs)) found.push(operation(verb, path, described));
  }
  document.getElementById("operations").replaceChildren(...found);
}
show();
