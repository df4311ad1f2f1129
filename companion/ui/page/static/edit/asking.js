// Requests to the editor's server, which are of this page's own origin.

// What the server answers; `error` is its refusal.
export async function got(path) {
  const answer = await fetch(`/edit/${path}`);
  return answer.json();
}

export async function posted(name, body = {}) {
  const answer = await fetch(`/edit/${name}`, { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) });
  return answer.json();
}
