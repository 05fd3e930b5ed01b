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

function operation(verb, path, described) {
  const head = element("summary", null, element("span", { class: "verb" }, verb.toUpperCase()), element("code", null, path),
    element("span", null, described.summary || ""));
  const body = [element("p", null, described.description || "")];
  if (described.parameters) body.push(element("ul", null, ...described.parameters.map(parameter)));
  return element("details", null, head, ...body);
}

async function show() {
  const document_ = await (await fetch("/openapi.json")).json();
  const found = [];
  for (const [path, verbs] of Object.entries(document_.paths)) {
    for (const [verb, described] of Object.entries(verbs)) found.push(operation(verb, path, described));
  }
  document.getElementById("operations").replaceChildren(...found);
}
show();
