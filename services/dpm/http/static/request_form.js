// SPDX-FileCopyrightText: 2026 the CDFF contributors
// SPDX-License-Identifier: BSD-3-Clause
// The form that requests a product from the orchestrator.
"use strict";

/** Longest time until the answer, milliseconds. */
const REQUEST_DEADLINE_MS = 60000;

/** Send the filled fields as a request; the answer names the product, or states why there is none. */
async function sendRequest(event) {
  event.preventDefault();
  const form = byId("request-form");
  const status = byId("request-status");
  const filled = [...new FormData(form)].map(([name, value]) => [name, value.trim()]).filter(([, value]) => value !== "");
  const body = JSON.stringify({ ...Object.fromEntries(filled), deadline_ms: REQUEST_DEADLINE_MS });
  const button = form.querySelector("button");
  button.disabled = true;
  status.replaceChildren("Waiting for the orchestrator …");
  try {
    const answer = await fetch("api/v1/requests", { method: "POST", headers: authorised({ "Content-Type": "application/json" }), body });
    const content = await answer.json();
    if (!answer.ok) throw new Error(content.detail || answer.statusText);
    const link = content.id ? make("a", { href: `api/v1/products/${encodeURIComponent(content.id)}` }, "Product") : "Answered without a product";
    status.replaceChildren(link, content.coverage === undefined ? "" : `, ${Math.round(content.coverage * 100)} % of the region`);
  } catch (error) {
    status.replaceChildren(error.message);
  }
  button.disabled = false;
  await showRequests();
}

async function fillRequestForm() {
  const [{ items: types }, { items: robots }] = await Promise.all([ask("api/v1/product_types"), ask("api/v1/robots")]);
  const form = byId("request-form");
  form.elements.type.replaceChildren(...types.map(({ name, title }) => make("option", { value: name }, title || words(name))));
  form.elements.robot.replaceChildren(...["any", ...robots.map(({ id }) => id)].map((id) => make("option", { value: id }, id)));
}

byId("request-form").addEventListener("submit", sendRequest);
untilAnswered(fillRequestForm);
