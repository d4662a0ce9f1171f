// Begin: read the study, take up a person's answers, show what is next.

try {
  const study = JSON.parse(find("study").textContent);
  const session = new Session(study);
  tell("");
  // The rest is for tests.
  window.lfstudy = { study, session, trialsOf, screens: new Screens(session) };
} catch (error) {
  tell(error.message);
}
